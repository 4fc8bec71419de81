"""The scalar reference of geometric conditions, and that the simulation means the same."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, Vocabulary, gene_pool
from bt_jax.behaviors.driving import approached, is_near
from bt_jax.behaviors.geometry import (
    can_be_taken,
    in_own_target,
    is_at,
    is_clear,
    is_graspable,
    is_in_reach,
    is_reachable,
    is_upright,
    is_within_reach,
    rests_on,
    taken_by,
    turn_error,
)
from bt_jax.behaviors.pose import Pose
from bt_jax.encoding.status import Status
from bt_jax.mjx_env.predicates import graspable
from bt_jax.mjx_env.predicates import in_own_target as batch_in_own_target
from bt_jax.mjx_env.predicates import is_upright as batch_is_upright
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.semantics import taken_by as batch_taken_by
from bt_jax.mjx_env.skills import act
from bt_jax.mjx_env.world import poses_by_name
from bt_jax.tasks import Base, Episode, Object, Robot, Target, load_task
from tests.helpers.random_states import jittered, random_world
from tests.helpers.samples import PARTS

MIXED, CUBES = load_task(PARTS), load_task("yumi_stack")
ONE_OF_ITS_OWN = dataclasses.replace(
    MIXED, name="named instance", targets=(*MIXED.targets, Target("Bolt3", (0.13, 0.0, 0.0275), "TrayA"))
)  # beside targets of its part
DRIVING = dataclasses.replace(
    MIXED,
    name="driving",
    robot_position=(0.0, 0.7, 0.9),
    robot=Robot(Base(0.75, stations=((0.0, 0.65), (-0.65, -0.65)))),
)
SIDES = [(math.sqrt(0.5), 0.0, 0.0), (0.0, math.sqrt(0.5), 0.0), (0.0, 0.0, math.sqrt(0.5))]
SEEDS = st.integers(0, 2**32 - 1)


def asked(task):
    """Conditions and picks of everything, and the places of the task's genes and targets."""
    targets = [(t.object, t.position, t.frame) if t.turn is None else (t.object, t.position, t.frame, t.turn)
               for t in task.targets]  # fmt: skip
    genes = [leaf.args for leaf in gene_pool(task).leaves if leaf.name == "move"][:40]
    names = [Behavior(name, (one,)) for name in ("clear", "reachable", "pick", "holding") for one in task.instances]
    on_itself = [("Bolt", (0.0, 0.0, 0.02), "Bolt1")] if "Bolt" in task.instances else []
    near = []
    if task.robot.base is not None:
        genes = [leaf.args for leaf in gene_pool(task).leaves if leaf.name == "carry"][:40:5]
        spots = [(name,) for name in (*task.instances, *task.kit_names)] + [(args[2], args[1]) for args in genes]
        near = [Behavior(name, args) for args in spots for name in ("reachable", "approach")]
        near += [Behavior("place", args) for args in genes]
    return tuple(dict.fromkeys([*names, *(Behavior("at", args) for args in [*targets, *genes, *on_itself]), *near]))


TASKS = (MIXED, ONE_OF_ITS_OWN, DRIVING, CUBES)
SEMANTICS = {task.name: LeafSemantics(task, Vocabulary.of(asked(task))) for task in TASKS}


def scalar_answers(task, world):
    """What the reference says of one state."""
    poses, held = poses_by_name(world, task), int(world.held[0])
    in_hand = task.object_names[held] if held >= 0 else None
    answers = {}

    def any_of(name, ask):
        return any(map(ask, task.instances[name]))

    for leaf in SEMANTICS[task.name].vocabulary.leaves:
        name = leaf.object
        match leaf.name:
            case "clear":
                found = any_of(name, lambda one: is_clear(task, poses, one, held=in_hand))
            case "reachable" if task.robot.base is not None:
                found = is_near(task, poses, name, leaf.position, held=in_hand)
            case "reachable":
                found = any_of(name, lambda one: is_in_reach(task, poses, one))
            case "approach":
                base = approached(task, poses, name, leaf.position, held=in_hand)
                found = Status.RUNNING if base else Status.FAILURE
                if is_near(task, poses, name, leaf.position, held=in_hand):
                    found = Status.SUCCESS
                elif base:
                    answers[f"driven to {leaf}"] = base
            case "place":
                place = tuple(poses[leaf.frame].apply(leaf.position).tolist())
                can = in_hand in task.instances[name] and in_hand != leaf.frame and is_within_reach(task, poses, place)
                found = Status.RUNNING if can else Status.FAILURE
                if answers[str(Behavior("at", leaf.args))] and in_hand is None:
                    found = Status.SUCCESS
            case "holding":
                found = in_hand in task.instances[name]
            case "pick":
                if in_hand in task.instances[name]:
                    found = Status.SUCCESS
                else:
                    can = world.gripper_open[0] and taken_by(task, poses, name, held=in_hand) is not None
                    found = Status.RUNNING if can else Status.FAILURE
            case "at":
                found = any_of(
                    name,
                    lambda one, leaf=leaf: one not in (in_hand, leaf.frame)
                    and is_at(task.thing(one), poses[one], poses[leaf.frame], leaf.position, turn=leaf.turn,
                              episode=task.episode),
                )  # fmt: skip
        answers[str(leaf)] = int(found)
    for name in task.instances:
        answers[f"taken by {name}"] = taken_by(task, poses, name, held=in_hand)
    for name in task.object_names:
        answers[f"{name} graspable"] = is_graspable(task, poses, name)
        answers[f"{name} upright"] = is_upright(task.thing(name), poses[name])
        answers[f"{name} done"] = name in in_own_target(task, poses, held=in_hand)
        assert can_be_taken(task, poses, name, held=in_hand) == (taken_by(task, poses, name, held=in_hand) is not None)
    return answers


def batch_answers(task, world):
    """What the simulation says of one state."""
    semantics = SEMANTICS[task.name]
    outcomes = semantics.outcomes(world)[0, 0] & 3
    answers = {str(leaf): int(outcomes[semantics.vocabulary.token(leaf)]) for leaf in semantics.vocabulary.leaves}
    for i, command in enumerate(semantics.commands):
        if command.name == "approach" and answers[str(command)] == Status.RUNNING:
            after = act(semantics, world, np.array([i], np.int32)).world
            answers[f"driven to {command}"] = tuple(np.round(after.base[0].astype(float), 4).tolist())
    free_hand = dataclasses.replace(world, gripper_open=np.array([True]))
    outcomes = semantics.outcomes(free_hand)[0, 0] & 3
    for i, name in enumerate(semantics.names):
        can = outcomes[semantics.vocabulary.token(Behavior("pick", (name,)))] == Status.RUNNING
        can |= bool(world.held[0] >= 0 and semantics.members[i][world.held[0]])  # which is SUCCESS
        taken = int(batch_taken_by(semantics, world, np.array([i], np.int32))[0])
        answers[f"taken by {name}"] = task.object_names[taken] if can else None
    for name, *values in zip(
        task.object_names,
        graspable(world, task)[0],
        batch_is_upright(world, task)[0] | np.zeros(len(task.objects), bool),
        batch_in_own_target(world, task)[0],
        strict=True,
    ):
        for word, value in zip(("graspable", "upright", "done"), values, strict=True):
            answers[f"{name} {word}"] = bool(value)
    return answers


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
@settings(max_examples=10)
@given(SEEDS)
def test_the_simulation_means_the_same_in_random_states(task, seed):
    rng = np.random.default_rng(seed)
    world = random_world(rng, task)
    expected = scalar_answers(task, world)
    assume(scalar_answers(task, jittered(world, rng)) == expected)  # away from limits: the simulation has 32 bits
    found = batch_answers(task, world)
    if world.held[0] >= 0:  # the reference knows nothing that a hand which is full could take
        mine = [name for name in task.instances if task.object_names[world.held[0]] in task.instances[name]]
        for answers in (expected, found):
            for name in mine:
                answers.pop(f"taken by {name}")
    assert found == expected


def upright(x, y, z, turn=0.0):
    half = math.radians(turn) / 2
    return Pose((x, y, z), (math.cos(half), 0.0, 0.0, math.sin(half)))


def thing(*size, shape="cuboid"):
    return Object("Thing", size, (0.0, 0.0, 0.0), shape=shape)


def test_what_lies_on_top_rests_on_it_and_what_lies_beside_does_not():
    cube, origin = thing(0.04, 0.04, 0.04), upright(0.0, 0.0, 0.0)
    assert rests_on(cube, upright(0.0, 0.0, 0.04), cube, origin)
    assert rests_on(cube, upright(0.03, -0.03, 0.04), cube, origin)
    assert not rests_on(cube, upright(0.041, 0.0, 0.04), cube, origin)
    assert not rests_on(cube, origin, cube, upright(0.0, 0.0, 0.04)), "the lower one does not rest on the upper one"
    assert not rests_on(cube, upright(0.0, 0.0, 0.08), cube, origin), "there is room for one between them"
    assert not is_reachable(cube, 0.02, 0.75)
    assert is_reachable(cube, 0.77, 0.75)


def test_shapes_reach_as_far_as_they_are_turned():
    plate, can = thing(0.2, 0.1, 0.02), thing(0.06, 0.06, 0.1, shape="cylinder")
    beside = upright(0.0, 0.11, 0.05 + 0.01)
    assert not rests_on(can, beside, plate, upright(0.0, 0.0, 0.0))
    assert rests_on(can, beside, plate, upright(0.0, 0.0, 0.0, turn=90.0))
    assert not rests_on(can, upright(0.0, 0.0, 0.04), plate, upright(0.0, 0.0, 0.0)), (
        "it stands beside, as high as it is"
    )
    lying = Pose((0.0, 0.0, 0.03 + 0.01), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))
    assert rests_on(can, lying, plate, upright(0.0, 0.0, 0.0))
    assert not is_upright(can, lying)
    assert is_upright(thing(0.04, 0.04, 0.04), lying), "a cube may stand on any face"


@given(
    st.sampled_from([((0.1, 0.1, 0.02), "cuboid"), ((0.1, 0.05, 0.02), "cuboid"), ((0.1, 0.1, 0.1), "cylinder")]),
    *[st.floats(-720, 720)] * 3,
)
def test_turns_are_counted_from_the_frame_and_to_the_nearest_that_looks_alike(size_and_shape, frame, turn, off):
    size, shape = size_and_shape
    one, off = thing(*size, shape=shape), off / 20  # at most 36 degrees, less than half of every symmetry
    for alike in range(4):
        pose = upright(0.0, 0.0, 0.0, frame + turn + off + alike * one.symmetry)
        found = turn_error(one, pose, upright(0.0, 0.0, 0.0, frame), turn)
        assert math.degrees(found) == pytest.approx(off if one.symmetry else 0.0, abs=1e-6)
        there = is_at(
            one, pose, upright(0.0, 0.0, 0.0, frame), (0.0, 0.0, 0.0), turn=turn, episode=Episode(turn_tolerance=10.0)
        )
        assert there == (not one.symmetry or abs(off) < 10)


def test_of_a_part_the_nearest_that_is_left_is_taken():
    task = MIXED
    poses = {name: upright(5.0 + i, 0.0, 0.8) for i, name in enumerate(task.object_names)}
    poses |= {
        "TrayA": upright(-1.0, 0.0, 0.7525),
        "TrayB": upright(2.0, 0.0, 0.7525),
        "base_link": upright(0.0, 1.0, 0.05),
    }
    poses |= {f"Bolt{i}": upright(0.0, -0.1 * i, 0.775) for i in (1, 2, 3)}
    assert taken_by(task, poses, "Bolt") == "Bolt1"
    assert taken_by(task, poses, "Bolt3") == "Bolt3"
    in_slot = {**poses, "Bolt1": upright(-1.0 + 0.05, -0.05, 0.78)}
    assert in_own_target(task, in_slot) == {"Bolt1"}
    assert taken_by(task, in_slot, "Bolt") == "Bolt2"
    assert taken_by(task, in_slot, "Bolt1") == "Bolt1", "by its own name it is taken from its slot"
    beside = {**in_slot, "Bolt3": upright(-1.0 + 0.05, -0.075, 0.78)}
    assert in_own_target(task, beside) == {"Bolt1"}, "only one stands in a slot"
    covered = {**in_slot, "Block": upright(0.0, -0.2, 0.775 + 0.04)}
    assert taken_by(task, covered, "Bolt") == "Bolt3"
    toppled = Pose((0.0, -0.3, 0.762), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))
    assert taken_by(task, {**covered, "Bolt3": toppled}, "Bolt") is None
    assert taken_by(task, {name: pose for name, pose in covered.items() if name != "Bolt3"}, "Bolt") is None


def test_an_instance_in_a_target_of_its_own_is_left_there_for_its_part():
    task = ONE_OF_ITS_OWN
    poses = {name: upright(5.0 + i, 0.0, 0.8) for i, name in enumerate(task.object_names)}
    poses |= {
        "TrayA": upright(-1.0, 0.0, 0.7525),
        "TrayB": upright(2.0, 0.0, 0.7525),
        "base_link": upright(0.0, 1.0, 0.05),
    }
    poses |= {f"Bolt{i}": upright(0.0, -0.1 * i, 0.775) for i in (1, 2)}
    for bolt3, done, taken in (((-0.87, 0.0), {"Bolt3"}, "Bolt1"), ((0.0, 0.1), set(), "Bolt3")):
        there = {**poses, "Bolt3": upright(*bolt3, 0.78)}
        assert in_own_target(task, there) == done
        assert taken_by(task, there, "Bolt") == taken
        assert taken_by(task, there, "Bolt3") == "Bolt3"
    elsewhere = {**poses, "Bolt1": upright(-0.87, 0.0, 0.78)}
    assert in_own_target(task, elsewhere) == frozenset(), "it is another's"


def test_fingers_need_room_beside_a_pair_of_faces_that_fits_the_opening():
    task = MIXED
    poses = {"TrayA": upright(-1.0, 0.0, 0.7525), "base_link": upright(0.0, 1.0, 0.05)}
    poses["Plate"] = upright(0.0, 0.0, 0.76)
    for y, free in ((0.2, True), (0.05, False)):  # a wall of the tray's is no neighbour, a can is
        assert is_graspable(task, {**poses, "Can": upright(0.0, y + 0.01, 0.79)}, "Plate") == free
    assert is_graspable(task, {**poses, "Can": upright(0.1, 0.0, 0.79)}, "Plate"), "no finger goes to the narrow side"
    for turn in (0.0, 45.0, 90.0):
        beside = {**poses, "Can": upright(0.3, 0.0, 0.79, turn), "Cube": upright(0.36, 0.0, 0.775)}
        assert is_graspable(task, beside, "Can"), "round ones are taken along the free axis however they are turned"


def test_fingers_go_between_an_object_and_a_turned_neighbour_where_that_leaves_room():
    """A bar at 45 degrees that the block around it, parallel to the axes, would not leave room beside."""
    task = MIXED
    poses = {"base_link": upright(0.0, 1.0, 0.05), "Bar1": upright(0.0, 0.0, 0.765, turn=45.0)}
    for gap, free in ((0.03, True), (0.0, False)):
        off = (0.015 + 0.012 + gap) / math.sqrt(2)  # of the middles
        assert is_graspable(task, {**poses, "Bolt1": upright(off, -off, 0.775)}, "Bolt1") == free
    block = upright(0.0, 0.0, 0.765, turn=45.0)
    for away, free in ((0.09, True), (0.06, False)):  # the fingers lie along the faces that they take
        beside = [upright(side * away / math.sqrt(2), away / math.sqrt(2), 0.79) for side in (-1, 1)]
        neighbours = dict(zip(("Can", "Cube"), beside, strict=True))
        assert is_graspable(task, {"base_link": poses["base_link"], "Block": block, **neighbours}, "Block") == free


@pytest.mark.parametrize("face", [(1.0, 0.0, 0.0, 0.0), *((math.sqrt(0.5), *axis) for axis in SIDES)])
def test_a_cube_is_taken_along_its_upright_faces_whichever_it_lies_on(face):
    names = MIXED.object_names[:5]
    cubes = tuple(dataclasses.replace(MIXED.thing("Cube"), name=name) for name in names)
    task = dataclasses.replace(MIXED, objects=cubes, targets=())
    around = [upright(x, y, 0.775) for x, y in ((0.06, 0.0), (-0.06, 0.0), (0.0, 0.06), (0.0, -0.06))]
    poses = dict(zip(names, [Pose((0.0, 0.0, 0.775), face), *around], strict=True))
    poses["base_link"] = upright(0.0, 1.0, 0.05)
    assert not is_graspable(task, poses, names[0])
    assert is_graspable(task, {name: poses[name] for name in (*names[:3], "base_link")}, names[0])
