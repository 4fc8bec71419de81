"""A small marked scene without a robot: the tables, the kit and the boxes of a task, and its camera."""

import functools
import os
import xml.etree.ElementTree as ET

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.twin.marker_scene import marker_scene
from bt_jax.deploy.twin.rendered_camera import RenderedCamera, cell_camera
from bt_jax.mjx_env.scene.mjcf import build_mjcf
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
PLACEMENT = cell_camera(TASK)
KIT = TASK.kits[0].name
TOP = TASK.tables[0].top


def upright(x: float, y: float, *, turn: float = 0.0, z: float = TOP + 0.02) -> RigidTransform:
    """A pose of a box on a table or at a height, m and rad."""
    return RigidTransform.from_components([x, y, z], Rotation.from_euler("z", turn))


class MarkedScene:
    """Puts bodies at poses and renders them; every image is 0.1 s newer."""

    def __init__(self) -> None:
        root, markers = ET.fromstring(build_mjcf(TASK)), marker_scene(TASK)
        markers.add_to(root)
        world = root.find("worldbody")
        world.append(ET.fromstring(PLACEMENT.mjcf("cell")))
        cover = '<geom type="box" size=".015 .015 .002" rgba=".4 .4 .4 1"/>'
        world.append(ET.fromstring(f'<body name="cover" pos="0 0 9"><freejoint/>{cover}</body>'))
        self.model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"), markers.files)
        self.data = mujoco.MjData(self.model)
        self.time = 0.0
        self.camera = RenderedCamera(self.model, lambda: (self.time, self.data.qpos))

    def put(self, name: str, pose: RigidTransform) -> None:
        at = self.model.jnt_qposadr[self.model.body(name).jntadr[0]]
        quaternion = pose.rotation.as_quat(scalar_first=True)
        self.data.qpos[at : at + 7] = [*pose.translation, *quaternion]

    def truth(self, name: str) -> RigidTransform:
        """In the base frame."""
        mujoco.mj_kinematics(self.model, self.data)
        body = self.data.body(name)
        return RigidTransform.from_components(body.xpos, Rotation.from_quat(body.xquat, scalar_first=True))

    def image(self) -> np.ndarray:
        self.time += 0.1
        return self.camera.read().image


@functools.cache
def marked_scene() -> MarkedScene:
    try:
        return MarkedScene()
    except Exception as error:
        pytest.skip(f"no software renderer here: {error}")


def fresh_scene() -> MarkedScene:
    """The scene with the boxes apart on the tables, seen by a camera without faults."""
    scene = marked_scene()
    scene.data.qpos[:] = scene.model.qpos0
    for name, (x, y, turn) in zip(
        TASK.object_names, [(0.28, 0.2, 0.4), (0.32, 0.27, 1.9), (0.3, -0.24, -0.7)], strict=True
    ):
        scene.put(name, upright(x, y, turn=turn))
    return scene


def errors(truth: RigidTransform, pose: RigidTransform) -> tuple[float, float]:
    """Distance in mm and angle in degrees."""
    turn = np.degrees((truth.rotation.inv() * pose.rotation).magnitude())
    return 1000 * float(np.linalg.norm(truth.translation - pose.translation)), float(turn)
