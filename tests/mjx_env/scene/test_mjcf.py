import itertools

import mujoco
import numpy as np
import pytest

from bt_jax.mjx_env.scene.mjcf import build_mjcf, compile_scene, resolve_ids, timing
from bt_jax.tasks import load_task, task_names
from bt_jax.tasks.support import kit_origin


@pytest.mark.parametrize("name", task_names())
def test_bodies_have_the_sizes_and_weights_of_the_task(name):
    task = load_task(name)
    model, ids = compile_scene(task)
    assert len(ids.objects) == len(task.objects)
    for box, body in zip(task.objects, ids.objects, strict=True):
        assert model.body(body).name == box.name
        geom, half = model.geom(box.name), np.array(box.size) / 2
        is_round = geom.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
        assert is_round == (box.shape == "cylinder")
        volume = np.pi * half[0] ** 2 * box.size[2] if is_round else np.prod(box.size)
        np.testing.assert_allclose(model.body_mass[body], box.density * volume, rtol=1e-6)
        np.testing.assert_allclose(geom.size[: 2 if is_round else 3], [half[0], half[2]] if is_round else half)
    for table in task.tables:
        geom = model.geom(table.name)
        np.testing.assert_allclose(geom.pos[2] + geom.size[2], table.top)
    assert model.nq == 7 * len(task.objects)
    assert list(ids.qpos) == [7 * i for i in range(len(task.objects))]
    assert list(ids.dof) == [6 * i for i in range(len(task.objects))]


@pytest.mark.parametrize("name", ["stack", "yumi_stack"])
def test_kit_is_an_open_box_on_the_table(name):
    task = load_task(name)
    model, ids = compile_scene(task)
    data = mujoco.MjData(model)
    for table in range(len(task.tables)):
        data.mocap_pos[ids.kit_mocaps[0]] = (*task.tables[table].position[:2], kit_origin(task, task.tables[table])[2])
        mujoco.mj_kinematics(model, data)
        plate = model.geom("plate")
        bottom = data.geom("plate").xpos[2] - plate.size[2]
        np.testing.assert_allclose(bottom, task.tables[table].top, atol=1e-9)
        for side, axis in (("left", 0), ("right", 0), ("front", 1), ("back", 1)):
            wall, place = model.geom(f"wall_{side}"), data.geom(f"wall_{side}").xpos
            inner = abs(place[axis] - data.mocap_pos[ids.kit_mocaps[0]][axis]) - wall.size[axis]
            np.testing.assert_allclose(inner, task.kits[0].inner[0], atol=1e-9)
            np.testing.assert_allclose(
                place[2] + wall.size[2] - bottom, task.kits[0].thickness + task.kits[0].wall_height, atol=1e-9
            )


def test_submodels_hold_only_the_boxes_named():
    task = load_task("stack")
    for count in range(len(task.objects) + 1):
        for names in itertools.combinations(task.object_names, count):
            model = mujoco.MjModel.from_xml_string(build_mjcf(task, names))
            ids = resolve_ids(model, task)
            assert tuple(model.body(body).name for body in ids.objects) == names


def test_scales_follow_froude():
    large, small = timing(load_task("stack")), timing(load_task("yumi_stack"))
    ratio = small.size / large.size
    np.testing.assert_allclose([small.step / large.step, small.speed / large.speed], ratio**0.5, rtol=1e-2)
    np.testing.assert_allclose(small.spin / large.spin, ratio**-0.5, rtol=1e-2)
