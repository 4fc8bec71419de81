import numpy as np
import pytest

from bt_jax.app.state.arrangement import goals, retarget, untarget
from bt_jax.app.state.spots import Spot, origins, spot_at, spot_of_target
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task, task_names


@pytest.mark.parametrize("name", task_names())
def test_spots_are_where_things_are(name):
    task = load_task(name)
    world = sample_layouts(task, 3, 1)
    for i, box in enumerate(task.object_names):
        spot = spot_at(task, world, box)
        point = spot.point(task, box, origins(task, world, ended=False))
        np.testing.assert_allclose(point, world.poses[0, i, :3], atol=1e-6)
        assert spot.up == pytest.approx(task.layout.stack.index(box) * 0.1 if box in task.layout.stack else 0, abs=2e-4)
    for box, goal in goals(task, world).items():
        spot = spot_of_target(task, world, box)
        np.testing.assert_allclose(spot.point(task, box, origins(task, world, ended=True)), goal, atol=1e-6)
        assert spot.frame(task) == next(t.frame for t in task.targets if t.object == box)


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
