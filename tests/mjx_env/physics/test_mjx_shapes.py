"""Cuboids and cylinders in MJX: what it simulates is what the C engine does."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.mjx_scene import stand_in_mjcf
from bt_jax.mjx_env.physics.newton import free_accelerations
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.scene.mjcf import compile_scene
from bt_jax.tasks import Task, load_task
from tests.helpers.samples import MIXED

TASK = load_task(MIXED)


def only(task: Task, *names: str) -> Task:
    """The task with these of its objects, and with as many targets as they leave."""
    targets = tuple(target for target in task.targets if target.object in names)
    return dataclasses.replace(task, objects=tuple(map(task.thing, names)), targets=targets)


@pytest.mark.parametrize("name", ["stack3", "kit4", "kit12", "bolts", "fixture", "yumi_kit6", MIXED])
def test_the_scene_has_the_bodies_of_the_c_engine_and_every_pair(name):
    task = load_task(name)
    model, (expected, ids) = mujoco.MjModel.from_xml_string(stand_in_mjcf(task)[0]), compile_scene(task)
    for thing, body in zip(task.object_names, ids.objects, strict=True):
        own = model.body(thing).id
        np.testing.assert_allclose(model.body_mass[own], expected.body_mass[body], rtol=1e-5)
        np.testing.assert_allclose(model.body_inertia[own], expected.body_inertia[body], rtol=1e-5)
    met = {frozenset(map(int, pair)) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    geoms = [model.body_geomadr[model.body(thing).id] for thing in task.object_names]
    assert {frozenset((a, b)) for a in geoms for b in geoms if a != b} <= met
    for geom in geoms:
        walls = sum(len(list(kit.walls())) + 1 for kit in task.kits)
        assert sum(geom in pair for pair in met) <= len(geoms) - 1 + 1 + len(task.tables) + walls


@given(st.lists(st.floats(-8, 8), min_size=12, max_size=12))
@settings(max_examples=15)
def test_free_objects_accelerate_as_in_the_c_engine(spins):
    """Without the gyroscopic term a turning plate would not wobble."""
    task = only(TASK, "Plate", "Can")
    model, ids = compile_scene(task)
    mass = [[*[model.body_mass[body]] * 3, *model.body_inertia[body]] for body in ids.objects]
    velocities = np.array(spins, np.float32).reshape(2, 6)
    gravity = np.array(model.opt.gravity, np.float32)
    free = free_accelerations(*map(jnp.asarray, (np.array(mass, np.float32), gravity, velocities)))
    data = mujoco.MjData(model)
    data.qpos[[ids.qpos[0] + 2, ids.qpos[1] + 2]] = 3, 5
    data.qvel[:] = np.float32(spins)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(np.asarray(free).ravel(), data.qacc, rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_what_is_put_down_rests_where_the_c_engine_leaves_it():
    """On tables, on each other, between dividers and where they cross."""
    task, count = only(TASK, "Plate", "Can"), 24
    rng = np.random.default_rng(0)
    layouts = sample_layouts(task, 0, count)
    poses = layouts.poses.copy()
    poses[..., 2] += rng.uniform(0, 0.01, poses.shape[:2])
    stacked, in_tray = np.arange(count) % 3 == 0, np.flatnonzero(np.arange(count) % 3 == 1)
    poses[stacked, 1, :3] = poses[stacked, 0, :3] + [0.02, 0.01, 0.065]
    tray, can = task.kits[1], task.thing("Can")
    places = np.array([tray.places[i % len(tray.places)].position for i in range(len(in_tray))])
    poses[in_tray, 1, :2] = layouts.kits[in_tray, 1, :2] + places + rng.uniform(-0.02, 0.02, places.shape)
    poses[in_tray, 1, 2] = layouts.kits[in_tray, 1, 2] + tray.plate + can.height / 2 + 0.002
    over = in_tray[places[:, 0] < 0]
    poses[over, 0, :3] = layouts.kits[over, 1] + [tray.inner[0] / 3, 0, tray.rim + 0.012]
    present = np.ones((count, 2), bool)
    other = jax.tree.map(np.asarray, make_physics(task, "mjx").settle(layouts.kits, poses, present))
    reference = make_physics(task, "mujoco", threads=1).settle(layouts.kits, poses, present)
    assert other.ok.all()
    np.testing.assert_allclose(other.poses[..., :3], reference.poses[..., :3], atol=1e-3)
    assert (np.abs((other.poses[..., 3:] * reference.poses[..., 3:]).sum(axis=-1)) > 0.999).all()


@pytest.mark.slow
def test_what_stands_stays_where_it_is_tick_after_tick():
    task = only(TASK, "Plate", "Can")
    layouts, physics = sample_layouts(task, 0, 24), make_physics(task, "mjx")
    poses = layouts.poses
    for _ in range(8):
        poses = np.asarray(physics.settle(layouts.kits, poses, np.ones(poses.shape[:2], bool)).poses)
    np.testing.assert_allclose(poses[..., :2], layouts.poses[..., :2], atol=1e-5)
