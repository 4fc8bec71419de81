"""The twin's camera: where it stands for a task, and its images, rendered from the state of a MuJoCo model."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.arrays import Matrix3
from bt_jax.deploy.perception.camera import CameraError, CameraFrame
from bt_jax.deploy.twin.sensor import Sensor
from bt_jax.deploy.twin.settings import Realism
from bt_jax.mjx_env.render.offscreen import View
from bt_jax.tasks import Task

__all__ = ["CameraPlacement", "RenderedCamera", "cell_camera"]

WIDTH, HEIGHT = 640, 480
DISTANCE = 0.95  # from the camera to the middle of the tables' tops, as a share of the row's length
ELEVATION = math.radians(48)  # over the kit's wall, and flat enough to see the sides of a twisted stack
EARLY = 0.05  # share of the time between two images by which one may come early
ROOM = 1.06  # of the picture's width, for boxes that stand at an edge
Indices = Int[np.ndarray, " n"]
OPENCV = np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras look along -z with y up


@dataclasses.dataclass(frozen=True)
class CameraPlacement:
    """A camera without distortion: `pose` of its frame (z forward, y down) in the world [m], vertical field of view `fovy`
    [deg], and the size of its images [px]."""

    pose: RigidTransform
    fovy: float
    width: int = WIDTH
    height: int = HEIGHT

    @property
    def matrix(self) -> Matrix3:
        """The camera matrix; the centre of the first pixel is (0, 0)."""
        focal = self.height / 2 / math.tan(math.radians(self.fovy) / 2)
        return np.array([[focal, 0, (self.width - 1) / 2], [0, focal, (self.height - 1) / 2], [0, 0, 1]])

    def mjcf(self, name: str) -> str:
        """Return the <camera> element for a worldbody."""
        axes = self.pose.rotation.as_matrix() @ OPENCV
        numbers = " ".join(f"{x:.9g}" for x in (*axes[:, 0], *axes[:, 1]))
        position = " ".join(f"{x:.9g}" for x in self.pose.translation)
        return f'<camera name="{name}" pos="{position}" xyaxes="{numbers}" fovy="{self.fovy:.9g}"/>'


def cell_camera(task: Task, *, width: int = WIDTH, height: int = HEIGHT) -> CameraPlacement:
    """Return where a camera with images of that size [px] sees all tables of a robot cell as large as it can: across the
    tables from the robot, and looking down at it, so that an arm that reaches for a box from above hides little."""
    positions = np.array([table.position for table in task.tables])
    halves = np.array([table.size for table in task.tables]) / 2
    low, high = (positions - halves).min(axis=0), (positions + halves).max(axis=0)
    row = int(np.argmax((high - low)[:2]))
    side = np.zeros(3)
    side[1 - row] = 1.0 if (low + high)[1 - row] / 2 >= task.robot_position[1 - row] else -1.0
    target = np.array([*((low + high) / 2)[:2], max(table.top for table in task.tables)])
    eye = target + DISTANCE * (high - low)[row] * (
        math.cos(ELEVATION) * side + math.sin(ELEVATION) * np.array([0, 0, 1])
    )
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    corners = np.array([[x, y, target[2]] for x in (low[0], high[0]) for y in (low[1], high[1])])
    seen = (corners - eye) @ rotation
    across = ROOM * np.abs(seen[:, 0] / seen[:, 2]).max()
    fovy = math.degrees(2 * math.atan(across * height / width))
    return CameraPlacement(RigidTransform.from_components(eye, Rotation.from_matrix(rotation)), fovy, width, height)


class RenderedCamera:
    """Render a camera of a model; `state` returns time [s] and qpos, as they are now, from wherever the model is simulated.
    Images are as good as `realism` says, by default perfect; `seed` draws what varies. Made and read in one thread, that of
    its OpenGL context. `freeze`, `lose`, `cover` and `change` are faults to be tried."""

    def __init__(
        self,
        model: mujoco.MjModel,
        state: Callable[[], tuple[float, Float[np.ndarray, " nq"]]],
        name: str = "cell",
        *,
        realism: Realism | None = None,
        seed: int | list[int] = 0,
    ) -> None:
        self._realism = realism or Realism.perfect()
        width, height = self._realism.width, self._realism.height
        self._model, self._state = model, state
        self._data = mujoco.MjData(model)
        self._view = View(model, name, width=width, height=height, shadows=False)  # they cost most of the time
        fovy = float(model.cam_fovy[model.camera(name).id])
        self._matrix = CameraPlacement(RigidTransform.identity(), fovy, width, height).matrix
        self._seed, self._sensor = seed, Sensor(self._realism, seed)
        self._newest: CameraFrame | None = None
        self._frozen = self._lost = False
        self._covered: dict[str, tuple[Indices, Indices]] = {}  # body -> its geoms and their materials

    def read(self) -> CameraFrame:
        """Return the newest image: the scene as it is now, unless the last one is so young that the camera has no other yet.
        Raise CameraError after `lose`."""
        if self._lost:
            raise CameraError("the camera gives no more images")
        if self._newest is not None and self._frozen:
            return self._newest
        time, qpos = self._state()
        if self._newest is not None and time - self._newest.time < (1 - EARLY) / self._realism.rate:
            return self._newest
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        image = self._sensor(self._view(self._data))
        self._newest = CameraFrame(image, float(time), self._matrix, np.zeros(5))
        return self._newest

    def freeze(self) -> None:
        """Keep the image as it is from now on."""
        self.read()
        self._frozen = True

    def lose(self) -> None:
        """Send no image from now on."""
        self._lost = True

    def cover(self, body: str) -> None:
        """Take the markers off a body."""
        geoms = np.flatnonzero(self._model.geom_bodyid == self._model.body(body).id)
        self._covered.setdefault(body, (geoms, self._model.geom_matid[geoms].copy()))
        self._model.geom_matid[geoms] = -1

    def uncover(self, body: str) -> None:
        """Put its markers back."""
        geoms, materials = self._covered.pop(body)
        self._model.geom_matid[geoms] = materials

    def move(self, body: str, pose: RigidTransform) -> None:
        """Show the kit, which is not part of the state, at another pose in the world."""
        place = self._model.body(body).mocapid[0]
        self._data.mocap_pos[place] = pose.translation
        self._data.mocap_quat[place] = pose.rotation.as_quat(scalar_first=True)

    def change(self, **values: float) -> None:
        """Make the images as good as a `Realism` with other values says, from now on."""
        self._sensor = Sensor(dataclasses.replace(self._realism, **values), self._seed)  # type: ignore[arg-type]

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._view.close()
