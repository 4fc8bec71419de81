import functools

import jax
import numpy as np
import pytest

from bt_jax.behaviors import Behavior
from bt_jax.mjx_env.physics.kinematic import Kinematic, settle
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.skills import act, settled_world
from bt_jax.mjx_env.world import snap
from bt_jax.tasks import load_task
from tests.helpers.samples import assert_same, kinematic_walk, semantics_of, sized

TASK = load_task("stack3")
PLATE_TOP = 0.755


def drop(*boxes, kit=(-1.0, 0.0, 0.7525)):
    """Where boxes come to rest that are let go at these places; the rest of the three take no part."""
    poses = np.zeros((1, 3, 7), np.float32)
    poses[..., 3] = 1
    present = np.zeros((1, 3), bool)
    for i, box in enumerate(boxes):
        poses[0, i, :3], present[0, i] = box, True
    settled = settle(TASK, np.array([[kit]], np.float32), poses, present)
    assert settled.ok.all()
    return settled.poses[0, : len(boxes)]


@pytest.mark.parametrize(
    ("start", "height"),
    [((0, 0, 2), 0.8), ((-1, 0, 1), PLATE_TOP + 0.05), ((0.5, 0, 1), 0.05), ((0.37, 0, 1), 0.8)],
)
def test_a_box_drops_to_its_support(start, height):
    np.testing.assert_allclose(drop(start)[0, :3], (*start[:2], height), atol=1e-6)


def test_a_box_beyond_the_edge_topples_to_the_floor():
    fallen = drop((0.40, 0.1, 0.8))[0]
    np.testing.assert_allclose(fallen[:3], (0.425, 0.1, 0.05), atol=1e-5)
    assert abs(fallen[3]) < 0.8


def test_a_box_stands_between_two():
    rest = drop((-0.06, 0, 0.8), (0.06, 0, 0.8), (0, 0, 1))
    np.testing.assert_allclose(rest[2, :3], (0, 0, 0.9), atol=1e-6)


def test_boxes_fall_together_the_lowest_first():
    rest = drop((0, 0, 3), (0, 0.01, 1), (0, 0.02, 2))
    np.testing.assert_allclose(rest[:, 2], (1.0, 0.8, 0.9), atol=1e-6)


@pytest.mark.parametrize("name", ["stack3", "restack", "yumi_stack"])
def test_what_rests_goes_on_resting(name):
    semantics, _, released = kinematic_walk(name, seed=0)
    once = settle(semantics.task, released.world.kits, released.poses, released.present)
    again = settle(semantics.task, released.world.kits, snap(once.poses), released.present)
    same = (snap(again.poses) == snap(once.poses)).all(axis=(1, 2))
    # Between YuMi's tables, one box wide apart, a box can lean where snapping takes away its support.
    assert same.all() if name != "yumi_stack" else same.mean() > 0.99
    absent = ~released.present
    np.testing.assert_array_equal(once.poses[absent], released.poses[absent])
    moved = np.linalg.norm(once.poses[..., :2] - released.poses[..., :2], axis=-1)
    np.testing.assert_allclose(once.reach, moved, atol=1e-6)


@pytest.mark.parametrize("name", ["stack3", "restack", "yumi_stack"])
def test_boxes_at_rest_do_not_meet_and_do_not_sink(name):
    semantics, _, released = kinematic_walk(name, seed=1)
    task = semantics.task
    poses = settle(task, released.world.kits, released.poses, released.present).poses
    size = sized(task)
    assert (poses[..., 2] >= task.floor + size / 2 - 1e-5).all()
    middle = (size[:, None] + size) / 2
    apart = (np.abs(poses[:, :, None, :3] - poses[:, None, :, :3]) > middle[..., None] * 0.95).any(axis=-1)
    both = released.present[:, :, None] & released.present[:, None] & ~np.eye(len(size), dtype=bool)
    assert (apart | ~both).mean() > 0.99  # toppled boxes may touch: there is no dynamics to part them


@pytest.mark.parametrize("name", ["stack3", "yumi_stack"])
def test_numpy_and_jax_agree(name):
    semantics, _, released = kinematic_walk(name, seed=2)
    arguments = released.world.kits, released.poses, released.present
    host = settle(semantics.task, *arguments)
    device = jax.device_get(jax.jit(functools.partial(settle, semantics.task))(*arguments))
    # Quarter turns of quarter turns: XLA may fuse a multiplication with an addition, NumPy does not.
    np.testing.assert_array_equal(device.poses[..., :3], host.poses[..., :3])
    np.testing.assert_allclose(device.poses[..., 3:], host.poses[..., 3:], atol=1e-6)
    np.testing.assert_allclose(device.reach, host.reach, atol=1e-6)
    assert_same((device.ok, device.steps), (host.ok, host.steps))


def test_stable_releases_end_where_physics_puts_them():
    semantics = semantics_of("stack3")
    world = sample_layouts(TASK, 3, 8)
    physics = {"kinematic": Kinematic(TASK), "mujoco": MujocoPhysics(TASK, threads=1)}
    rest = {}
    for name, level in physics.items():
        state = world
        for gene in (
            Behavior("move", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox")),
            Behavior("move", ("GreenBox", (0.0, 0.0, 0.1), "YellowBox")),
            Behavior("move", ("BlueBox", (0.133, 0.133, 0.055), "KittingBox")),
        ):
            for command in (Behavior("pick", (gene.object,)), Behavior("place", gene.args)):
                index = np.full(8, semantics.commands.index(command), np.int32)
                released = act(semantics, state, index)
                settled = level.settle(released.world.kits, released.poses, released.present)
                state = settled_world(TASK, released, np.asarray(settled.poses))
        rest[name] = state.poses[..., :3]
    np.testing.assert_allclose(rest["kinematic"], rest["mujoco"], atol=2e-3)


def test_a_box_let_go_beside_the_tables_falls_to_a_floor_below_zero():
    task = load_task("yumi_stack")
    layouts = sample_layouts(task, 0, 1)
    poses = layouts.poses.copy()
    poses[0, 0, :3] = (0.3, 0.8, 0.3)
    rest = settle(task, layouts.kits, poses, np.ones((1, 3), bool)).poses
    assert task.floor < 0
    assert rest[0, 0, 2] == pytest.approx(task.floor + task.objects[0].edge / 2, abs=1e-6)
