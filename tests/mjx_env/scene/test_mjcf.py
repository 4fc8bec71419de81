import dataclasses
import itertools
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.physics.mjx_scene import stand_in_mjcf
from bt_jax.mjx_env.scene.mjcf import build_mjcf, compile_scene, resolve_ids, timing
from bt_jax.tasks import load_task, task_names
from bt_jax.tasks.checks import check
from bt_jax.tasks.support import kit_origin

PARTS = load_task(Path(__file__).parents[2] / "helpers" / "parts.yaml")


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
        plate = model.geom("KittingBox/plate")
        bottom = data.geom("KittingBox/plate").xpos[2] - plate.size[2]
        np.testing.assert_allclose(bottom, task.tables[table].top, atol=1e-9)
        for side, axis in (("left", 0), ("right", 0), ("front", 1), ("back", 1)):
            wall, place = model.geom(f"KittingBox/wall_{side}"), data.geom(f"KittingBox/wall_{side}").xpos
            inner = abs(place[axis] - data.mocap_pos[ids.kit_mocaps[0]][axis]) - wall.size[axis]
            np.testing.assert_allclose(inner, task.kits[0].inner[0], atol=1e-9)
            np.testing.assert_allclose(
                place[2] + wall.size[2] - bottom, task.kits[0].thickness + task.kits[0].wall_height, atol=1e-9
            )


def test_what_is_not_named_in_the_task_has_a_name_that_no_task_can_give():
    """Of the kinds of names that objects, kits and tables have."""
    own = {*PARTS.object_names, *PARTS.kit_names, *(table.name for table in PARTS.tables)}
    for xml in (build_mjcf(PARTS, gripper=True), stand_in_mjcf(PARTS)[0]):
        named = [one for kind in ("body", "geom", "material") for one in ElementTree.fromstring(xml).iter(kind)]
        others = {one.attrib["name"] for one in named if "name" in one.attrib} - own
        assert "scene/floor" in others
        assert all("/" in name for name in others)


@pytest.mark.parametrize("name", ["slot", "divider_0", "TrayB_plate", "finger_left", "gripper", "near_TableLeft_0"])
def test_an_object_may_be_called_like_anything_in_the_scene(name):
    objects = tuple(dataclasses.replace(one, name=name) if one.name == "Cube" else one for one in PARTS.objects)
    targets = tuple(one for one in PARTS.targets if one.object != "Cube")
    task = dataclasses.replace(PARTS, objects=objects, targets=targets)
    check(task, "mine")
    model, ids = compile_scene(task, gripper=True)
    assert [model.body(body).name for body in ids.objects] == list(task.object_names)
    mujoco.MjModel.from_xml_string(stand_in_mjcf(task)[0])


@pytest.mark.parametrize("name", ["nothing", "world"])
def test_what_means_something_else_is_no_name(name):
    objects = (dataclasses.replace(PARTS.objects[0], name=name), *PARTS.objects[1:])
    with pytest.raises(UserError, match=f"the name '{name}' is reserved for"):
        check(dataclasses.replace(PARTS, objects=objects), "mine")


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
