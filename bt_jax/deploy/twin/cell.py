"""The cell as a MuJoCo model: the task's scene with a robot, markers and a camera, in a random layout."""

from __future__ import annotations

import copy
import dataclasses
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.planning.feasibility import check_scale
from bt_jax.deploy.planning.pose_geometry import level
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.robot.mjcf import add_to_mjcf
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.twin.marker_scene import marker_scene
from bt_jax.deploy.twin.rendered_camera import CameraPlacement, cell_camera
from bt_jax.deploy.twin.settings import Realism
from bt_jax.deploy.twin.simulated_robot import CellModel
from bt_jax.mjx_env.scene.mjcf import build_mjcf
from bt_jax.mjx_env.scene.placement import draw_kit_table, draw_poses
from bt_jax.tasks import Task

__all__ = ["CAMERA", "FILM", "STRANGER", "TwinScene", "box_poses", "build_scene", "solved", "target_distances"]

Qpos = Float[np.ndarray, " nq"]
"""A state of the twin's model: positions of joints, m and rad; free bodies by position and quaternion wxyz."""

CAMERA, FILM = "cell", "film"
STRANGER = "stranger"  # an object that the task does not know
NARROWER = 0.875  # size of one without markers, as a share of a box's
STEP = 0.002  # seconds of physics
STIFF = "0.005 1"  # of contacts, s and damping ratio: a box that falls must not sink into the kit's thin plate
SHELL = '<material name="shell" rgba=".88 .88 .86 1" specular=".3" shininess=".4"/>'


LENS = 0.1  # px that the residual of the lens is said to be
POINTS = 8  # markers from which the camera's place is said to be known


@dataclasses.dataclass(frozen=True)
class TwinScene:
    """A cell for the twin's controller, its compiled model, and the pose of the kit in the world. `camera` is where the
    camera is, in the world; `calibrated` is where our side believes it to be, in the robot's base frame."""

    robot: RobotModel
    task: Task
    cell: CellModel
    model: mujoco.MjModel
    kit: RigidTransform
    realism: Realism
    camera: CameraPlacement
    calibrated: RigidTransform

    @property
    def calibration(self) -> tuple[Intrinsics, CameraPose]:
        """What `calibrate` would have found, which is wrong by as much as `realism` says."""
        camera = self.camera
        lens = Intrinsics(camera.matrix, np.zeros(5), camera.width, camera.height, LENS)
        return lens, CameraPose(self.calibrated, self.realism.camera_error, POINTS)


def build_scene(
    robot: RobotModel,
    task: Task,
    seed: int | list[int],
    realism: Realism | None = None,
    *,
    stranger: str | None = None,
) -> TwinScene:
    """Return a robot in the cell of a task, with boxes at random places and turned at random; the same for the same seed.
    It is as real as `realism` says, by default as a real one. With `stranger`, an object that the task does not know lies
    out of sight, with the markers of the box of that name, without any if it is "". Raise UserError for a task that is not
    at the robot's scale."""
    check_scale(robot, task)
    realism = realism or Realism()
    rng = np.random.default_rng(seed)
    table = task.tables[draw_kit_table(task, rng)]
    kit = np.array([*table.position[:2], table.top + task.kit.thickness / 2])
    places = draw_poses(task, rng, table)[:, :3]
    turns = rng.uniform(-np.pi, np.pi, len(task.objects))
    for name in task.layout.stack:
        turns[task.object_names.index(name)] = 0.0
    installed = cell_camera(task, width=realism.width, height=realism.height)
    camera = dataclasses.replace(
        installed, pose=_shifted(installed.pose, np.array(realism.camera_moved), np.array(realism.camera_turned))
    )
    files, text = _mjcf(robot, task, kit, camera, stranger)
    model = mujoco.MjModel.from_xml_string(text, files)
    qpos = model.qpos0.copy()
    for name, place, turn in zip(task.object_names, places, turns, strict=True):
        at = model.jnt_qposadr[model.body(name).jntadr[0]]
        qpos[at : at + 7] = [*place, *Rotation.from_euler("z", turn).as_quat(scalar_first=True)]
    for arm in robot.arms:
        for joint, angle in zip(arm.joint_names, arm.home, strict=True):
            qpos[model.joint(joint).qposadr[0]] = angle
        for finger in arm.finger_names:
            qpos[model.joint(finger).qposadr[0]] = arm.gripper.stroke
    cell = CellModel(
        xml=text,
        assets=files,
        qpos=qpos,
        joints={arm.name: arm.joint_names for arm in robot.arms},
        actuators={arm.name: arm.actuator_names for arm in robot.arms},
        finger_joints={arm.name: arm.finger_names for arm in robot.arms},
        finger_actuators={arm.name: arm.finger_names for arm in robot.arms},
        flanges={arm.name: f"{arm.name}_tool0" for arm in robot.arms},
        grippers={arm.name: arm.gripper for arm in robot.arms},
    )
    directions = np.random.default_rng([*np.ravel(seed), 2]).normal(size=(2, 3))
    error, tilt = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    calibrated = _shifted(installed.pose, realism.camera_error * error, realism.camera_tilt * tilt)
    to_base = RigidTransform.from_translation(task.robot_position).inv()
    return TwinScene(
        robot, task, cell, model, RigidTransform.from_translation(kit), realism, camera, to_base * calibrated
    )


def _shifted(pose: RigidTransform, by: Point, turn: Point) -> RigidTransform:
    """Return a pose shifted [m] and turned about its own place [rad], along and about fixed axes."""
    return RigidTransform.from_components(pose.translation + by, Rotation.from_rotvec(turn) * pose.rotation)


def _mjcf(
    robot: RobotModel, task: Task, kit: Point, camera: CameraPlacement, stranger: str | None
) -> tuple[dict[str, bytes], str]:
    """Return the files that the model names, and its text."""
    root, markers = ET.fromstring(build_mjcf(task)), marker_scene(task)
    _found(root, "compiler").set("angle", "radian")
    option = _found(root, "option")
    for key, value in {"timestep": STEP, "cone": "elliptic", "impratio": 10, "integrator": "implicitfast"}.items():
        option.set(key, str(value))
    _found(root, "visual/quality").set("offsamples", "0")
    for geom in root.iter("geom"):
        if "solref" in geom.attrib:
            geom.set("solref", STIFF)
    assets = _found(root, "asset")
    assets.extend(ET.fromstring(f"<asset>{markers.assets_xml}{SHELL}</asset>"))
    body = _found(root, f"worldbody/body[@name='{task.kit.name}']")
    body.set("pos", " ".join(map(repr, map(float, kit))))
    body.extend(ET.fromstring(f"<body>{markers.kit_xml}</body>"))
    for box in task.objects:
        _found(root, f".//geom[@name='{box.name}']").set("material", f"{box.name}_markers")
    _found(root, "worldbody").append(ET.fromstring(camera.mjcf(CAMERA)))
    _found(root, "worldbody").append(ET.fromstring(_film_camera(task)))
    add_to_mjcf(robot, root, task.robot_position)
    if stranger is not None:
        _found(root, "worldbody").append(_stranger(root, task, stranger))
    return markers.files, ET.tostring(root, encoding="unicode")


def _stranger(root: ET.Element, task: Task, markers: str) -> ET.Element:
    """Return a body like a box, with the markers of the one of that name, or narrower and without any if it is ""."""
    box = next((box for box in task.objects if box.name == markers), task.objects[0])
    body = copy.deepcopy(_found(root, f".//body[@name='{box.name}']"))
    geom, half = _found(body, "geom"), box.edge / 2 * (1 if markers else NARROWER)
    body.set("name", STRANGER)
    body.set("pos", f"2 0.5 {task.floor + half!r}")
    geom.set("name", STRANGER)
    if not markers:
        geom.attrib.pop("material")
        geom.set("size", f"{half!r} {half!r} {half!r}")
        geom.set("rgba", "0.45 0.4 0.35 1")
    return body


def _found(root: ET.Element, path: str) -> ET.Element:
    found = root.find(path)
    assert found is not None, f"the scene has no {path}"
    return found


def _film_camera(task: Task) -> str:
    """Return a camera that sees robot and tables from the front left."""
    base = np.array(task.robot_position)
    tables = np.mean([[*table.position[:2], table.top] for table in task.tables], axis=0)
    target = 0.35 * base + 0.65 * tables + [0, 0, 0.16]
    eye = target + (tables - base) * 2.9 + [0, -0.62, 0.5]
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    axes = " ".join(map(repr, map(float, (*right, *np.cross(right, forward)))))
    return f'<camera name="{FILM}" pos="{" ".join(map(repr, map(float, eye)))}" xyaxes="{axes}" fovy="44"/>'


def box_poses(scene: TwinScene, qpos: Qpos) -> dict[str, RigidTransform]:
    """Return the true poses of the boxes in the world, from a state of the model."""
    poses = {}
    for name in scene.task.object_names:
        at = scene.model.jnt_qposadr[scene.model.body(name).jntadr[0]]
        poses[name] = RigidTransform.from_components(
            qpos[at : at + 3], Rotation.from_quat(qpos[at + 3 : at + 7], scalar_first=True)
        )
    return poses


def target_distances(scene: TwinScene, qpos: Qpos) -> list[float]:
    """Return how far each target's object truly is from its place [m]; on top of a box is against gravity, whichever face
    it lies on."""
    poses = {name: level(pose) for name, pose in box_poses(scene, qpos).items()} | {
        scene.task.kit.name: scene.kit,
        scene.task.robot_frame: RigidTransform.from_translation(scene.task.robot_position),
    }
    return [
        float(np.linalg.norm(poses[target.frame].apply(target.position) - poses[target.object].translation))
        for target in scene.task.targets
    ]


def solved(scene: TwinScene, qpos: Qpos) -> bool:
    """Is every object where its target is, within the task's tolerance?"""
    return all(distance < scene.task.episode.tolerance for distance in target_distances(scene, qpos))
