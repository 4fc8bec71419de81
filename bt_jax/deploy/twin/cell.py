"""The cell as a MuJoCo model: the task's scene with a robot, markers and a camera, in a random layout."""

from __future__ import annotations

import copy
import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors.geometry import is_upright, turn_error
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.planning.feasibility import check_scale
from bt_jax.deploy.planning.pose_geometry import plain, stood
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.robot.mjcf import add_to_mjcf
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.twin.marker_scene import marker_scene
from bt_jax.deploy.twin.rendered_camera import CameraPlacement, cell_camera
from bt_jax.deploy.twin.settings import Realism
from bt_jax.deploy.twin.simulated_robot import CellModel
from bt_jax.mjx_env.scene.mjcf import build_mjcf
from bt_jax.mjx_env.scene.placement import draw_kit_table, draw_poses
from bt_jax.tasks import Target, Task
from bt_jax.tasks.support import kit_origin

__all__ = ["CAMERA", "FILM", "STRANGER", "TwinScene", "box_poses", "build_scene", "solved", "target_distances"]

Qpos = Float[np.ndarray, " nq"]
"""A state of the twin's model: positions of joints, m and rad; free bodies by position and quaternion wxyz."""

CAMERA, FILM = "cell", "film"
STRANGER = "scene/stranger"  # an object that the task does not know
WRONG = 1.0  # m that an instance counts as farther from a target in which it lies wrongly
NARROWER = 0.875  # size of one without markers, as a share of a box's
OPTIONS = {  # of the physics
    "timestep": 0.002,
    "cone": "elliptic",
    "impratio": 10,
    "integrator": "implicitfast",
    # MuJoCo's defaults: within the fewer steps of a task's scene, the line search among elliptic cones sometimes finds no
    # better point, and what the fingers hold is thrown with the forces of its start.
    "iterations": 100,
    "ls_iterations": 50,
}
STIFF = "0.005 1"  # of contacts, s and damping ratio: a box that falls must not sink into the kit's thin plate
SHELL = '<material name="scene/shell" rgba=".88 .88 .86 1" specular=".3" shininess=".4"/>'


LENS = 0.1  # px that the residual of the lens is said to be
POINTS = 8  # markers from which the camera's place is said to be known


@dataclasses.dataclass(frozen=True)
class TwinScene:
    """A cell for the twin's controller, its compiled model, and the poses of the kits in the world. `camera` is where the
    camera is, in the world; `calibrated` is where our side believes it to be, in the robot's base frame."""

    robot: RobotModel
    task: Task
    cell: CellModel
    model: mujoco.MjModel
    kits: Mapping[str, RigidTransform]
    realism: Realism
    camera: CameraPlacement
    calibrated: RigidTransform

    @property
    def kit(self) -> RigidTransform:
        """The pose of the first kit."""
        return self.kits[self.task.kit_names[0]]

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
    """Return a robot in the cell of a task, with objects at random places and turned at random; the same for the same seed.
    It is as real as `realism` says, by default as a real one. With `stranger`, an object that the task does not know lies
    out of sight, with the markers of the object of that name, without any if it is "". Raise UserError for a task that is
    not at the robot's scale."""
    check_scale(robot, task)
    realism = realism or Realism()
    rng = np.random.default_rng(seed)
    table = task.tables[draw_kit_table(task, rng)]
    kits = {name: RigidTransform.from_translation(kit_origin(task, table, name)) for name in task.kit_names}
    places = draw_poses(task, rng, table)
    turns = rng.uniform(-np.pi, np.pi, len(task.objects))
    given = (*task.layout.stack, *(place.object for place in task.layout.fixed))
    for i, turn in enumerate(turns):
        if not task.layout.turn and task.object_names[i] not in given:
            places[i, 3:] = Rotation.from_euler("z", turn).as_quat(scalar_first=True)
    installed = cell_camera(task, width=realism.width, height=realism.height)
    camera = dataclasses.replace(
        installed, pose=_shifted(installed.pose, np.array(realism.camera_moved), np.array(realism.camera_turned))
    )
    files, text = _mjcf(robot, task, kits, camera, stranger)
    model = mujoco.MjModel.from_xml_string(text, files)
    qpos = model.qpos0.copy()
    for name, place in zip(task.object_names, places, strict=True):
        at = model.jnt_qposadr[model.body(name).jntadr[0]]
        qpos[at : at + 7] = place
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
    return TwinScene(robot, task, cell, model, kits, realism, camera, to_base * calibrated)


def _shifted(pose: RigidTransform, by: Point, turn: Point) -> RigidTransform:
    """Return a pose shifted [m] and turned about its own place [rad], along and about fixed axes."""
    return RigidTransform.from_components(pose.translation + by, Rotation.from_rotvec(turn) * pose.rotation)


def _mjcf(
    robot: RobotModel,
    task: Task,
    kits: Mapping[str, RigidTransform],
    camera: CameraPlacement,
    stranger: str | None,
) -> tuple[dict[str, bytes], str]:
    """Return the files that the model names, and its text."""
    root, markers = ET.fromstring(build_mjcf(task)), marker_scene(task)
    for geom in root.iter("geom"):
        if "euler" in geom.attrib:  # in degrees, as `build_mjcf` writes them
            geom.set("euler", _text(np.radians([float(angle) for angle in geom.attrib["euler"].split()])))
    _found(root, "compiler").set("angle", "radian")
    option = _found(root, "option")
    for key, value in OPTIONS.items():
        option.set(key, str(value))
    _found(root, "visual/quality").set("offsamples", "0")
    for geom in root.iter("geom"):
        if "solref" in geom.attrib:
            geom.set("solref", STIFF)
    markers.add_to(root)
    _found(root, "asset").append(ET.fromstring(SHELL))
    for name, pose in kits.items():
        _found(root, f"worldbody/body[@name='{name}']").set("pos", _text(pose.translation))
    _found(root, "worldbody").append(ET.fromstring(camera.mjcf(CAMERA)))
    _found(root, "worldbody").append(ET.fromstring(_film_camera(task)))
    add_to_mjcf(robot, root, task.robot_position)
    if stranger is not None:
        _found(root, "worldbody").append(_stranger(root, task, stranger))
    return markers.files, ET.tostring(root, encoding="unicode")


def _stranger(root: ET.Element, task: Task, markers: str) -> ET.Element:
    """Return a body like an object, with the markers of the one of that name, or narrower and without any if it is ""."""
    thing = next((thing for thing in task.objects if thing.name == markers), task.objects[0])
    body = copy.deepcopy(_found(root, f".//body[@name='{thing.name}']"))
    geom, share = _found(body, "geom"), 1 if markers else NARROWER
    body.set("name", STRANGER)
    body.set("pos", f"2 0.5 {task.floor + share * thing.height / 2!r}")
    geom.set("name", STRANGER)
    for sticker in body.findall("geom")[1:]:
        sticker.set("name", f"{STRANGER}_{sticker.attrib['name']}")
        if not markers:
            body.remove(sticker)
    if not markers:
        geom.attrib.pop("material")
        geom.set("size", _text(share * np.array([float(half) for half in geom.attrib["size"].split()])))
        geom.set("rgba", "0.45 0.4 0.35 1")
    return body


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


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
    """Return the true poses of the objects in the world, from a state of the model."""
    poses = {}
    for name in scene.task.object_names:
        at = scene.model.jnt_qposadr[scene.model.body(name).jntadr[0]]
        poses[name] = RigidTransform.from_components(
            qpos[at : at + 3], Rotation.from_quat(qpos[at + 3 : at + 7], scalar_first=True)
        )
    return poses


def target_distances(scene: TwinScene, qpos: Qpos) -> list[float]:
    """Return how far each target's object truly is from its place [m]; on top of a cube is against gravity, whichever face
    it lies on. Of a part, the instances that fit its targets best."""
    return [distance for distance, _ in _misses(scene, qpos)]


def solved(scene: TwinScene, qpos: Qpos) -> bool:
    """Is every object where its target is and turned as it says, within the task's tolerances?"""
    return all(lies and distance < scene.task.episode.tolerance for distance, lies in _misses(scene, qpos))


def _misses(scene: TwinScene, qpos: Qpos) -> list[tuple[float, bool]]:
    """Return for each target how far its object is from it [m], and whether that lies as it should."""
    task = scene.task
    poses = {name: stood(task.thing(name), pose) for name, pose in box_poses(scene, qpos).items()} | {
        **scene.kits,
        task.robot_frame: RigidTransform.from_translation(task.robot_position),
    }
    found: dict[int, tuple[float, bool]] = {}
    for name in dict.fromkeys(target.object for target in task.targets):
        numbers = [i for i, target in enumerate(task.targets) if target.object == name]
        misses = [[_miss(task, poses, task.targets[i], one) for one in task.instances[name]] for i in numbers]
        costs = np.array([[distance + (0.0 if lies else WRONG) for distance, lies in row] for row in misses])
        rows, columns = linear_sum_assignment(costs)
        found |= {numbers[row]: misses[row][column] for row, column in zip(rows, columns, strict=True)}
    return [found[i] for i in range(len(task.targets))]


def _miss(task: Task, poses: Mapping[str, RigidTransform], target: Target, name: str) -> tuple[float, bool]:
    """Return how far an object is from a target [m], and whether it stands there upright and turned as it should."""
    thing, pose, frame = task.thing(name), poses[name], poses[target.frame]
    lies = is_upright(thing, plain(pose))
    if target.turn is not None:
        off = turn_error(thing, plain(pose), plain(frame), target.turn)
        lies = lies and abs(off) < math.radians(task.episode.turn_tolerance)
    return float(np.linalg.norm(frame.apply(target.position) - pose.translation)), lies
