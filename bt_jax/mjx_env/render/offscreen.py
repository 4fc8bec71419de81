"""Pictures and films of a scene, without a screen."""

from __future__ import annotations

import contextlib
import copy
import ctypes
import ctypes.util
import dataclasses
import importlib
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.scene.mjcf import DRIVEN_BASE, FIELD_OF_VIEW, GRIPPER, compile_scene, gripper_unit
from bt_jax.tasks import Task

__all__ = ["GripperPose", "Renderer", "View", "available", "contact_sheet", "write_film"]

ARM_COLOUR = (0.62, 0.64, 0.67, 1.0)
Picture = UInt8[np.ndarray, "height width 3"]
LINK = 0.62  # length of each of the arm's two links, in its reach
WRIST = 1.5  # height of the wrist over the fingertips, in units of the gripper
INSTALL = "on Debian or Ubuntu install libegl1, libegl-mesa0 and libgl1-mesa-dri, or libosmesa6"


@dataclasses.dataclass(frozen=True)
class GripperPose:
    """Where to draw the gripper: `position` [m, world] is the point between the fingertips, thus the centre of a box
    that it holds; `opening` [m] is the distance between the fingers, which close along x; `yaw` [rad] turns it
    about z."""

    position: Float[np.ndarray, "3"] | tuple[float, float, float]
    opening: float
    yaw: float = 0.0


@dataclasses.dataclass(frozen=True)
class Rod:
    """A straight piece of an arm: its ends and its radius, metres in the world."""

    one: Float[np.ndarray, "3"]
    other: Float[np.ndarray, "3"]
    radius: float


class View:
    """What a camera of a model sees, drawn without a screen; use it from one thread, and call `close()`.

    Raises UserError if nothing can draw here.
    """

    def __init__(self, model: mujoco.MjModel, camera: str, *, width: int, height: int, shadows: bool = True) -> None:
        if reason := _missing():
            raise UserError(f"pictures cannot be drawn here: {reason}; {INSTALL}")
        self._model, self._size = model, (width, height)
        try:
            self._gl = _gl_class()(width, height)
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:
            raise UserError(f"pictures cannot be drawn here ({error}); {INSTALL}") from error
        mujoco.mjr_resizeOffscreen(width, height, self._context)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=500)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._option = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(camera).id

    def __call__(self, data: mujoco.MjData, caption: str = "", rods: Sequence[Rod] = ()) -> Picture:
        """Return an RGB picture of a state whose kinematics, cameras and lights are up to date, with rods beside what the
        model has."""
        width, height = self._size
        self._gl.make_current()
        mujoco.mjv_updateScene(
            self._model, data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        for rod in rods:
            self._add(rod)
        view = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(view, self._scene, self._context)
        if caption:
            place, font = mujoco.mjtGridPos.mjGRID_TOPLEFT, mujoco.mjtFont.mjFONT_NORMAL
            mujoco.mjr_overlay(font, place, view, caption, "", self._context)
        picture = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(picture, None, view, self._context)
        return np.ascontiguousarray(picture[::-1])

    def _add(self, rod: Rod) -> None:
        geom = self._scene.geoms[self._scene.ngeom]
        kind, colour = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(ARM_COLOUR, np.float32)
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
        mujoco.mjv_connector(geom, kind, rod.radius, np.asarray(rod.one, float), np.asarray(rod.other, float))
        self._scene.ngeom += 1

    def close(self) -> None:
        """Release the graphics memory."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._gl = None


class Renderer:
    """Draw scenes of one task; use it in a `with` statement, or call `close()`.

    `samples` is the number of samples a pixel for smooth edges; 0 is fastest. Raises UserError if nothing
    can draw here.
    """

    def __init__(
        self, task: Task, *, width: int = 960, height: int = 540, camera: str = "overview", samples: int = 4
    ) -> None:
        shared, self._ids = compile_scene(task, gripper=True)
        self._model = copy.copy(shared)
        self._model.vis.quality.offsamples = samples
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        across = math.tan(math.radians(FIELD_OF_VIEW / 2))
        self._model.cam_fovy[self._model.camera(camera).id] = math.degrees(2 * math.atan(across * height / width))
        self._task = task
        self._data = mujoco.MjData(self._model)
        self._view = View(self._model, camera, width=width, height=height)

    def __call__(
        self,
        kits: Float[np.ndarray, "T 3"],
        poses: Float[np.ndarray, "B 7"],
        gripper: GripperPose | None = None,
        caption: str = "",
        base: Float[np.ndarray, "2"] | None = None,
    ) -> Picture:
        """Return an RGB picture, with a caption at its top left. `kits` [m, world] are the kits' frames, `poses` are xyz and
        wxyz of all boxes of the task, `base` is where a base stands that the task has, with an arm to the gripper."""
        data = self._data
        data.qpos[:] = np.asarray(poses, float).ravel()
        data.mocap_pos[list(self._ids.kit_mocaps)] = kits
        self._place_gripper(gripper)
        if base is not None:
            body = self._model.body_mocapid[self._model.body(DRIVEN_BASE).id]
            data.mocap_pos[body] = (*base, self._task.floor)
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        return self._view(data, caption, self._arm(gripper, base))

    def _place_gripper(self, gripper: GripperPose | None) -> None:
        parts = [self._model.body_mocapid[self._model.body(name).id] for name in GRIPPER]
        if gripper is None:
            self._data.mocap_pos[parts] = (0, 0, -1000)
            return
        half = gripper.opening / 2
        along = np.array([math.cos(gripper.yaw), math.sin(gripper.yaw), 0.0])
        self._data.mocap_pos[parts] = np.asarray(gripper.position) + np.array([0 * along, half * along, -half * along])
        self._data.mocap_quat[parts] = (math.cos(gripper.yaw / 2), 0, 0, math.sin(gripper.yaw / 2))

    def _arm(self, gripper: GripperPose | None, base: Float[np.ndarray, "2"] | None) -> list[Rod]:
        """Return the two links of the arm on a base, which meet at an elbow above the line from its shoulder to the
        gripper."""
        if gripper is None or base is None or self._task.robot.base is None:
            return []
        shoulder = np.array([*base, self._task.robot_position[2]])
        x, y, z = gripper.position
        wrist = np.array([x, y, z + WRIST * gripper_unit(self._task)])
        apart, up = wrist - shoulder, np.array([0.0, 0.0, 1.0])
        half, link = float(np.linalg.norm(apart)) / 2, LINK * self._task.robot.base.reach
        across = up - (up @ apart) * apart / max(4 * half**2, 1e-9)
        if np.linalg.norm(across) < 0.05:  # the gripper is above the shoulder
            across = np.array([1.0, 0.0, 0.0])
        rise = math.sqrt(max(link**2 - half**2, 0.0)) / float(np.linalg.norm(across))
        elbow = shoulder + apart / 2 + rise * across
        radius = 0.16 * self._task.robot.base.radius
        return [Rod(shoulder, elbow, radius), Rod(elbow, wrist, radius)]

    def close(self) -> None:
        """Release the graphics memory."""
        self._view.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def available() -> bool | str:
    """Return True if pictures can be drawn, else the reason why not, as a non-empty string: compare with `is True`."""
    return _missing() or True


def _gl_name() -> str:
    """Return the graphics library to use. MuJoCo itself decides by MUJOCO_GL when it is imported, and takes a screen for
    granted; here a screen is never needed."""
    asked = os.environ.get("MUJOCO_GL", "").lower()
    if asked in ("egl", "osmesa", "glfw"):
        return asked
    if sys.platform != "linux":
        return "native"
    fixed = os.environ.get("PYOPENGL_PLATFORM", "").lower()  # PyOpenGL cannot change once it is loaded
    if fixed in ("egl", "osmesa"):
        return fixed
    return "egl" if _egl_devices() or not ctypes.util.find_library("OSMesa") else "osmesa"


def _egl_devices() -> int:
    library = ctypes.util.find_library("EGL")
    if library is None:
        return 0
    with contextlib.suppress(OSError, AttributeError):
        egl = ctypes.CDLL(library)
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
        if address:
            count = ctypes.c_int(0)
            query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))(
                address
            )
            query(0, None, ctypes.byref(count))
            return count.value
    return 0


def _gl_class() -> type:
    name = _gl_name()
    if name == "native":
        from mujoco.gl_context import GLContext

        return GLContext
    return importlib.import_module(f"mujoco.{name}").GLContext


def _missing() -> str:
    name = _gl_name()
    if name == "egl" and not _egl_devices():
        return "neither EGL nor OSMesa is installed"
    if name == "osmesa" and not ctypes.util.find_library("OSMesa"):
        return "OSMesa is not installed"
    return ""


def contact_sheet(
    frames: Sequence[Picture], *, columns: int = 3, rows: int = 2, gap: int = 6
) -> UInt8[np.ndarray, "sheet_height sheet_width 3"]:
    """Return one picture of `columns * rows` frames evenly spread over a film, from the first to the last, on white."""
    wanted = min(columns * rows, len(frames))
    chosen = [frames[round(i)] for i in np.linspace(0, len(frames) - 1, wanted)]
    columns = min(columns, wanted)
    height, width, _ = frames[0].shape
    lines = math.ceil(wanted / columns)
    sheet = np.full((lines * (height + gap) - gap, columns * (width + gap) - gap, 3), 255, np.uint8)
    for i, frame in enumerate(chosen):
        top, left = i // columns * (height + gap), i % columns * (width + gap)
        sheet[top : top + height, left : left + width] = frame
    return sheet


def write_film(path: str | Path, frames: Sequence[Picture], fps: float | int = 25) -> None:
    """Write frames as .mp4, .gif, or .png (a contact sheet of the film; a single frame as it is).

    Raises UserError if there are no frames, the ending is another or the file cannot be written.
    """
    import imageio.v3 as imageio

    path = Path(path)
    if not len(frames):
        raise UserError(f"there is nothing to write to {path}; draw at least one frame")
    try:
        match path.suffix.lower():
            case ".mp4":
                even = [frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2] for frame in frames]
                imageio.imwrite(path, np.stack(even), fps=fps, codec="libx264", macro_block_size=1, quality=8)
            case ".gif":
                imageio.imwrite(path, np.stack(frames), duration=1000 / fps, loop=0)
            case ".png":
                imageio.imwrite(path, frames[0] if len(frames) == 1 else contact_sheet(frames))
            case _:
                raise UserError(f"{path} is not a film; let its name end in .mp4, .gif or .png")
    except OSError as error:
        raise UserError(f"{path} cannot be written ({error}); check the folder and its permissions") from error
