import dataclasses
import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import SIMULATED_TICK
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import box_poses, build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.fault_injector import FaultInjector, check_faults
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.deploy.twin.simulated_gripper import GripperFault
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.mjx_env.faults.fates import sample_fates
from bt_jax.mjx_env.faults.variants import JAMS, SLIPS
from bt_jax.tasks import Faults, load_task, with_faults

TASK = load_task("yumi_stack")
SCENE = build_scene(YUMI, TASK, 0)
TREE = parse_tree("move(YellowBox, (0, 0, 0.022), KittingBox)")
PICK, PLACE = parse_behavior("pick(YellowBox)"), parse_behavior("place(YellowBox, (0, 0, 0.022), KittingBox)")


class Camera(RenderedCamera):
    """A camera that only notes what is covered."""

    def __init__(self):
        self.covered = set()

    def cover(self, body):
        self.covered.add(body)

    def uncover(self, body):
        self.covered.remove(body)


class Cell(Controller):
    """A cell without a robot: `put` puts at once."""

    def __init__(self):
        self.qpos, self.grippers, self.camera = SCENE.cell.qpos.copy(), GripperFault.NONE, Camera()

    def state(self):
        return 0.0, self.qpos

    def gripper_fault(self, fault):
        self.grippers = fault

    def put(self, body, pose):
        at = SCENE.model.jnt_qposadr[SCENE.model.body(body).jntadr[0]]
        self.qpos[at : at + 7] = [*pose.translation, *pose.rotation.as_quat(scalar_first=True)]

    def pose(self, name):
        return box_poses(SCENE, self.qpos)[name]


def in_kit(x, y, z):
    return SCENE.kit.translation + np.array([x, y, z])


def injector(cell, faults, *, seed=0, draw=0):
    program = Program(with_faults(TASK, faults), TREE)
    return FaultInjector(program, SCENE, cell, cell.camera, seed, draw, 0.0)


def report(phase, action=None, holding=None):
    return TickReport(Observation(0.0, {}, {}, holding), None, action, phase)


def attempt(inject, action, holding=None, now=0.0):
    """One attempt from its start to its end; return what happened at its start."""
    before = len(inject.touches)
    inject(now, report("starting", action, holding))
    happened = [touch.what for touch in inject.touches[before:]]
    inject(now, report("acting", action, holding))
    inject(now, report("committed", action, holding))
    inject(now, report("settling"))
    return happened


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 1000), st.integers(0, 3))
def test_attempts_meet_the_fates_of_the_simulation(seed, draw):
    """The nth attempt goes as that command does in the nth tick of the same layout and draw."""
    faults = Faults(slip=0.4, jam=0.3)
    inject = injector(Cell(), faults, seed=seed, draw=draw)
    fates = sample_fates(with_faults(TASK, faults), seed, layouts=1, draws=draw + 1)
    expected = fates.variant[draw, :8, 2 + TASK.kinds.index("YellowBox")]
    names = {0: [], JAMS: ["jam"], SLIPS: ["slip"]}
    assert [attempt(inject, PICK) for _ in range(8)] == [names[int(variant)] for variant in expected]


@pytest.mark.parametrize(
    ("faults", "gripper"), [(Faults(jam=1.0), GripperFault.JAM), (Faults(slip=1.0), GripperFault.WEAK)]
)
def test_grippers_fail_for_one_attempt(faults, gripper):
    cell = Cell()
    inject = injector(cell, faults)
    for phase in ("starting", "acting", "committed"):
        inject(0.0, report(phase, PICK))
        assert cell.grippers == gripper
    inject(0.0, report("settling"))
    assert cell.grippers == GripperFault.NONE


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 1000), st.floats(-0.25, 0.25), st.floats(0, math.pi))
def test_what_is_dropped_stands_below_on_a_table_and_no_longer_in_the_hand(seed, aside, turn):
    cell = Cell()
    inject = injector(cell, Faults(drop=1.0), seed=seed)
    start, goal = cell.pose("YellowBox").translation, SCENE.kit.translation
    side = np.array([-(goal - start)[1], (goal - start)[0], 0]) / np.linalg.norm((goal - start)[:2])
    holding = {"action": PLACE, "holding": "YellowBox"}
    inject(0.0, report("starting", **holding))
    for share in np.linspace(0, 1, 21):
        here = start + share * (goal - start) + 4 * share * (1 - share) * aside * side + [0, 0, 0.1]
        if not inject.touches:
            cell.put("YellowBox", RigidTransform.from_components(here, Rotation.from_euler("z", turn)))
            inject(0.0, report("acting", **holding))
    assert [touch.what for touch in inject.touches] == ["drop"]
    pose = cell.pose("YellowBox")
    tables = [
        table
        for table in TASK.tables
        if np.all(np.abs(pose.translation[:2] - table.position[:2]) < np.array(table.size[:2]) / 2)
    ]
    assert tables
    assert pose.translation[2] >= min(table.top for table in tables) + 0.02
    assert pose.translation[2] < here[2]
    assert (pose.rotation * Rotation.from_euler("z", turn).inv()).magnitude() < 1e-3


def test_a_box_that_is_being_set_down_is_not_dropped():
    cell = Cell()
    inject = injector(cell, Faults(drop=1.0))
    inject(0.0, report("starting", PLACE, "YellowBox"))
    cell.put("YellowBox", RigidTransform.from_translation(in_kit(0, 0, 0.022)))
    inject(0.0, report("committed", PLACE, "YellowBox"))
    inject(0.0, report("settling"))
    assert not inject.touches


def test_what_is_placed_misses_its_place_by_gaussian_errors():
    spread, errors, cell = 0.004, [], Cell()
    inject, place = injector(cell, Faults(place_spread=spread, turn_spread=2.0)), in_kit(0, 0, 0.0205)
    for _ in range(60):
        cell.put("YellowBox", RigidTransform.from_translation(place))
        attempt(inject, PLACE, "YellowBox")
        pose = cell.pose("YellowBox")
        errors.append([*(pose.translation - place), math.degrees(pose.rotation.as_euler("xyz")[2])])
    spreads = np.std(errors, axis=0)
    assert spreads == pytest.approx([spread, spread, 0.0, 2.0], rel=0.3, abs=1e-5)
    assert np.abs(np.mean(errors, axis=0)[:2]).max() < 3 * spread / math.sqrt(60)


def test_what_was_set_down_elsewhere_or_not_let_go_is_left_alone():
    for place, phases in (([0.1, 0, 0.0205], ("acting", "committed")), ([0, 0, 0.0205], ("acting", "acting"))):
        cell = Cell()
        inject = injector(cell, Faults(place_spread=0.01))
        inject(0.0, report("starting", PLACE, "YellowBox"))
        cell.put("YellowBox", RigidTransform.from_translation(in_kit(*place)))
        for phase in phases:
            inject(0.0, report(phase, PLACE, "YellowBox"))
        inject(0.0, report("settling"))
        assert not inject.touches


def test_an_object_is_out_of_sight_for_so_many_ticks():
    cell = Cell()
    inject = injector(cell, Faults(hide=0.2, hide_ticks=2, objects=("GreenBox",)))
    seen = []
    for i in range(600):
        inject(0.1 * i, report("waiting"))
        seen.append(cell.camera.covered == set())
        assert cell.camera.covered <= {"GreenBox"}
    hidden = np.flatnonzero(np.diff([True, *seen, True])).reshape(-1, 2)
    assert len(hidden)
    lengths = [end - begin for begin, end in hidden if end < 600]
    assert np.allclose(lengths, 2 * SIMULATED_TICK / 0.1, atol=1)


def test_a_person_moves_takes_and_brings_back_what_is_free():
    cell = Cell()
    inject = injector(cell, Faults(move=0.3, take=0.3, take_ticks=2))
    away = set()
    for i in range(900):
        before = {name: cell.pose(name) for name in TASK.object_names}
        known = len(inject.touches)
        inject(0.1 * i, report("acting", PICK, "YellowBox"))
        for touch in inject.touches[known:]:
            moved = np.linalg.norm(cell.pose(touch.box).translation - before[touch.box].translation)
            assert moved > 0.001
            if touch.what == "remove":
                away.add(touch.box)
            elif touch.what == "return":
                away.remove(touch.box)
            else:
                assert touch.what == "move"
                assert touch.box not in away
    assert {"move", "remove", "return"} <= {touch.what for touch in inject.touches}


@pytest.mark.parametrize("draw", range(3))
def test_the_same_draw_gives_the_same_again_and_another_one_something_else(draw):
    def happened(draw):
        cell = Cell()
        inject = injector(cell, dataclasses.replace(Faults(), slip=0.4, move=0.2, hide=0.2), draw=draw)
        for i in range(40):
            attempt(inject, PICK, now=3.0 * i)
        return inject.touches, cell.qpos.tolist()

    assert happened(draw) == happened(draw)
    assert happened(draw)[0] != happened(draw + 1)[0]


def test_what_is_dropped_or_misplaced_meets_nothing_that_presses_on_it():
    """Nothing is put into something else, deeper than the simulation does, which the contacts would throw about."""
    cell, data = Cell(), mujoco.MjData(SCENE.model)
    inject = injector(cell, Faults(place_spread=0.02, turn_spread=20.0))
    for _ in range(20):
        cell.put("YellowBox", RigidTransform.from_translation(in_kit(0, 0, 0.0215)))
        cell.put("GreenBox", RigidTransform.from_translation(in_kit(0.05, 0, 0.0215)))
        attempt(inject, PLACE, "YellowBox")
        data.qpos[:] = cell.qpos
        mujoco.mj_forward(SCENE.model, data)
        boxes = {SCENE.model.geom(name).id for name in TASK.object_names}
        deep = [contact.dist for contact in data.contact if boxes & set(contact.geom.tolist())]
        assert min(deep, default=0.0) > -0.005


def test_what_cannot_be_provoked_is_said():
    hidden = with_faults(TASK, Faults(hide=0.1))
    check_faults(hidden, realtime=False)
    check_faults(with_faults(TASK, Faults(slip=0.1)), realtime=True)
    check_faults(TASK, realtime=True)
    with pytest.raises(UserError, match="hide objects need simulated time; leave out --realtime"):
        check_faults(hidden, realtime=True)
