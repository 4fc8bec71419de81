import dataclasses

import numpy as np
import pytest

from bt_jax.app.state.goals import goals, target_keys
from bt_jax.app.state.retargeting import retarget, untarget
from bt_jax.app.state.spots import Spot, origins, references, spot_at, spot_of_target
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task, task_names
from tests.helpers.trays import TRAYS


@pytest.mark.parametrize("name", task_names())
def test_spots_are_where_things_are(name):
    task = load_task(name)
    world = sample_layouts(task, 3, 1)
    for i, box in enumerate(task.object_names):
        spot = spot_at(task, world, box)
        point = spot.point(task, box, origins(task, world, ended=False))
        np.testing.assert_allclose(point, world.poses[0, i, :3], atol=1e-6)
        assert spot.up == pytest.approx(task.layout.stack.index(box) * 0.1 if box in task.layout.stack else 0, abs=2e-4)
    assert_spots_of_targets(task, world)


def assert_spots_of_targets(task, world):
    for key, goal in goals(task, world).items():
        spot = spot_of_target(task, world, key)
        point = spot.point(task, goal.thing, origins(task, world, ended=True))
        np.testing.assert_allclose(point, goal.pose[:3], atol=1e-6)
        assert (spot.frame(task), spot.turn) == (target_keys(task)[key].frame, target_keys(task)[key].turn)


def test_spots_in_several_kits_and_of_several_targets_of_one_part():
    world = sample_layouts(dataclasses.replace(TRAYS, layout=dataclasses.replace(TRAYS.layout, turn=80.0)), 3, 1)
    assert_spots_of_targets(TRAYS, world)
    for i, name in enumerate(TRAYS.object_names):
        spot = spot_at(TRAYS, world, name)
        point = spot.point(TRAYS, name, origins(TRAYS, world, ended=False))
        np.testing.assert_allclose(point, world.poses[0, i, :3], atol=1e-6)
    assert spot_at(TRAYS, world, "Can").turn is None
    assert abs(spot_at(TRAYS, world, "Plate").turn) > 1
    assert references(TRAYS, "Bolt") == ["TrayA", "TrayB", "Cube", "Plate", "Can", *(t.name for t in TRAYS.tables)]


@pytest.mark.parametrize("name", ["stack", "yumi_stack"])
def test_a_target_said_in_words_is_the_one_that_is_meant(name):
    task = load_task(name)
    world = sample_layouts(task, 3, 1)
    size = task.objects[0].edge
    where = origins(task, world, ended=True)
    on_green = Spot("GreenBox", 0.0, 0.0, 0.0)
    changed = retarget(
        task,
        MujocoPhysics(task, threads=1),
        world,
        "BlueBox",
        on_green.point(task, "BlueBox", where),
        on_green.frame(task),
    )
    assert next(t for t in changed.targets if t.object == "BlueBox").position == (0.0, 0.0, size)
    beside = Spot("KittingBox", 1.32 * size, 0.0, 0.0)
    changed = retarget(
        task, MujocoPhysics(task, threads=1), world, "BlueBox", beside.point(task, "BlueBox", where), beside.frame(task)
    )
    target = next(t for t in changed.targets if t.object == "BlueBox")
    assert np.dot(target.position, task.right) == pytest.approx(task.genes.pitch, abs=1e-3)
    assert spot_of_target(changed, world, "BlueBox").up == pytest.approx(0, abs=1e-3)


def test_a_target_on_a_table_is_told_from_its_middle():
    task = untarget(load_task("stack3"), "BlueBox")
    world = sample_layouts(task, 0, 1)
    spot = Spot("TableLeft", 0.1, -0.05, 0.0)
    changed = retarget(
        task,
        MujocoPhysics(task, threads=1),
        world,
        "BlueBox",
        spot.point(task, "BlueBox", origins(task, world, ended=True)),
        None,
    )
    assert changed.targets[2].frame == "base_link"
    again = spot_of_target(changed, world, "BlueBox")
    assert again.reference == "TableLeft"
    np.testing.assert_allclose([again.right, again.away, again.up], [0.1, -0.05, 0], atol=1e-3)
