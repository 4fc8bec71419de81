"""Plans for objects of other shapes, for parts and for slots that are filled at the start."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.encoding.arrays import violations
from bt_jax.lfd.evaluation.random_kits import random_kit_task
from bt_jax.lfd.planner import plan_task
from bt_jax.tasks import Target, load_task
from bt_jax.tasks.slots import slot_position, slot_turn
from bt_jax.tasks.support import kit_origin, resolve
from bt_jax.tasks.things import Kit, Object
from tests.helpers.demonstrations import asides, playbacks

TRAY = Kit("Tray", (0.5, 0.3), wall_height=0.02, table="TableLeft", grid=(1, 2))
BOLTS = tuple(Object(f"Bolt{i}", (0.04, 0.04, 0.06), (0.5, 0.5, 0.5), shape="cylinder", part="Bolt") for i in (1, 2, 3))
CAN = Object("Can", (0.07, 0.07, 0.1), (0.7, 0.1, 0.1), shape="cylinder")
PLATE = Object("Plate", (0.18, 0.1, 0.03), (0.2, 0.4, 0.7))
BRICKS = tuple(Object(f"Brick{i}", (0.08, 0.04, 0.04), (0.5, 0.3, 0.7), part="Brick") for i in (1, 2))


def kit(objects, targets, *fixed):
    """A task with a tray of two slots, in which objects may start: (name, slot, turn)."""
    kitting = load_task("kit4")
    named = {thing.name: thing for thing in objects} | {thing.part: thing for thing in objects if thing.part}
    slots = {slot.name: slot for slot in TRAY.places}
    origin = kit_origin(dataclasses.replace(kitting, kits=(TRAY,)), kitting.tables[0])
    x, y, z = np.subtract(origin, kitting.robot_position).tolist()

    def in_slot(name, slot, turn):
        a, b, c = slot_position(TRAY, slots[slot], named[name])
        return Target(name, (x + a, y + b, z + c), kitting.robot_frame, turn)

    goals = [
        Target(name, slot_position(TRAY, slots[slot], named[name]), "Tray", turn, f"Tray.{slot}")
        for name, slot, turn in targets
    ]
    layout = dataclasses.replace(kitting.layout, fixed=tuple(in_slot(*one) for one in fixed))
    return dataclasses.replace(kitting, objects=objects, kits=(TRAY,), targets=tuple(goals), layout=layout)


def moved(task):
    """What the robot moves while it carries out a plan that works, in two layouts."""
    found = []
    for played in playbacks(plan_task(task), task, seed=8, count=2):
        assert played.solved
        found.append([tick.command.object for tick in played.ticks if tick.command and tick.command.name == "place"])
    assert found[0] == found[1]
    return found[0]


def test_cubes_are_turned_to_fit_between_dividers():
    task = load_task("kit4")
    cubes = tuple(Object(name, (0.08, 0.08, height), (0.5, 0.5, 0.5)) for name, height in (("A", 0.08), ("B", 0.04)))
    tray = Kit("Tray", (0.3, 0.2), wall_height=0.03, grid=(2, 3), dividers=True)
    places = {slot.name: slot for slot in tray.places}
    goals = tuple(
        Target(thing.name, slot_position(tray, places[slot], thing), "Tray", slot_turn(tray, places[slot], thing))
        for thing, slot in zip(cubes, ("r1c1", "r2c3"), strict=True)
    )
    task = dataclasses.replace(task, objects=(*cubes, CAN), kits=(tray,), targets=goals)
    assert all(played.solved for played in playbacks(plan_task(task), task, seed=0, count=4))


def test_the_right_part_in_a_slot_stays_there():
    task = kit(BOLTS, [("Bolt", "r1c1", None), ("Bolt", "r1c2", None)], ("Bolt2", "r1c1", None))
    assert moved(task) == ["Bolt"]


def test_a_part_in_a_slot_for_something_else_goes_to_its_own_slot_first():
    task = kit((*BOLTS[:1], CAN), [("Can", "r1c1", None), ("Bolt", "r1c2", None)], ("Bolt1", "r1c1", None))
    assert moved(task) == ["Bolt", "Can"]


def test_a_spare_part_in_a_slot_for_something_else_is_put_aside():
    task = kit((*BOLTS[:2], CAN), [("Can", "r1c1", None)], ("Bolt1", "r1c1", None))
    assert moved(task) == ["Bolt1", "Can"]


def test_where_no_place_is_free_what_stands_on_top_goes_to_its_own_slot_first():
    blocks = tuple(Object(name, (0.08, 0.08, 0.08), (0.9, 0.7, 0.1)) for name in ("Lower", "Upper"))
    task = kit(blocks, [("Lower", "r1c1", None), ("Upper", "r1c2", None)])
    layout = dataclasses.replace(task.layout, stack=("Lower", "Upper"))
    tables = tuple(dataclasses.replace(one, size=(0.5, 0.3, one.size[2])) for one in task.tables)
    full = dataclasses.replace(task, layout=layout, tables=tables)
    assert moved(full) == ["Upper", "Lower"]


def test_parts_in_slots_for_each_other_change_places():
    goals = [("Bolt", "r1c1", None), ("Brick", "r1c2", 0.0)]
    task = kit((*BOLTS[:1], *BRICKS[:1]), goals, ("Brick1", "r1c1", 0.0), ("Bolt1", "r1c2", None))
    assert len(moved(task)) == 3


def test_a_part_that_lies_wrong_in_its_slot_is_the_one_that_is_turned():
    task = kit(BRICKS, [("Brick", "r1c1", 90.0), ("Brick", "r1c2", 0.0)], ("Brick2", "r1c1", 0.0))
    assert moved(task) == ["Brick2", "Brick"]


def test_what_leaves_the_fingers_no_room_is_moved_first():
    """The plate can only be taken across its long edges, beside one of which a can stands."""
    task = kit((PLATE, CAN), [("Plate", "r1c2", 0.0)])
    edge = (PLATE.size[1] + CAN.size[1]) / 2 + task.finger_room / 2
    places = [("Plate", (-1.0, -1.3, 0.715)), ("Can", (-1.0, -1.3 + edge, 0.75))]
    fixed = tuple(Target(name, place, task.robot_frame) for name, place in places)
    task = dataclasses.replace(task, layout=dataclasses.replace(task.layout, fixed=fixed))
    assert moved(task) == ["Can", "Plate"]
    free = dataclasses.replace(task, finger_room=0.0)
    assert moved(free) == ["Plate"]


def test_a_part_that_stands_where_it_should_be_is_put_aside_while_what_is_below_it_moves():
    task = kit((CAN, *BOLTS[:2]), [("Can", "r1c1", None)])
    can = Target("Can", (-1.0, -1.3, 0.75), task.robot_frame)
    bolt = Target("Bolt1", (-1.0, -1.3, 0.83), task.robot_frame)
    task = dataclasses.replace(
        task,
        targets=(*task.targets, Target("Bolt", (0.0, 0.0, 0.08), "Can")),
        layout=dataclasses.replace(task.layout, fixed=(can, bolt)),
    )
    assert moved(task) == ["Bolt1", "Can", "Bolt"]


def test_what_would_leave_the_fingers_no_room_is_placed_last():
    task = kit((PLATE, CAN), [("Can", "r1c1", None), ("Plate", "r1c2", 0.0)])
    edge = (PLATE.size[1] + CAN.size[1]) / 2 + task.finger_room / 2
    x, y, z = -1.0, -1.3, 0.715
    fixed = (Target("Plate", (x, y, z), task.robot_frame),)
    can = Target("Can", (x, y + edge, 0.75), task.robot_frame)
    task = dataclasses.replace(
        task, targets=(can, task.targets[1]), layout=dataclasses.replace(task.layout, fixed=fixed)
    )
    assert moved(task) == ["Plate", "Can"]


def test_a_target_in_the_frame_of_a_turned_object_turns_with_it():
    task = kit((PLATE, *BOLTS[:1]), [("Plate", "r1c1", 90.0)])
    task = dataclasses.replace(task, targets=(*task.targets, Target("Bolt", (0.05, 0.0, 0.045), "Plate")))
    assert resolve(task, task.targets[1])[1] == pytest.approx((-0.1225, 0.05, 0.0625), abs=1e-6)
    assert moved(task) == ["Plate", "Bolt"]


def test_objects_that_are_put_aside_lie_as_the_plan_says():
    """However the plate is turned in its stack, it is known what it fills once it has been put aside."""
    stack, turned = ("Can", "Plate"), 180.0
    task = kit((CAN, PLATE), [("Can", "r1c1", None)])
    task = dataclasses.replace(task, layout=dataclasses.replace(task.layout, stack=stack, turn=turned))
    (aside,) = asides(task)
    assert aside.object == "Plate"
    assert aside.turn in (0.0, 90.0)
    assert moved(task) == ["Plate", "Can"]


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_plans_solve_random_kits(seed):
    rng = np.random.default_rng(seed)
    task = random_kit_task(load_task("kit4"), objects=int(rng.integers(2, 7)), rng=rng)
    tree = plan_task(task)
    assert violations(tree, gene_under_fallback=False) == []
    assert plan_task(task) == tree
    (played,) = playbacks(tree, task, seed=seed, count=1)
    assert played.solved
