"""A person who demonstrates in the twin's cell: takes boxes by hand and puts them elsewhere, as people do, with a tremor, at
an uneven pace, with pauses, and never quite where they mean to. The robot's arms rest at home meanwhile."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.twin.cell import TwinScene, box_poses
from bt_jax.tasks import Target

__all__ = ["Demonstrator", "Manner"]

TICK = 0.01  # s between two positions of the hand
TREMOR = ((2.1, 0.6), (8.7, 0.25), (10.3, 0.25))  # Hz, and share of the amplitude (physiological tremor: 8 to 12 Hz)
RESTED = 0.2  # share of it that is left once what the hand holds touches something
HIGH = 0.09  # m above the tables at which the hand carries
AWAY = (0.40, 0.50, 0.16)  # m from the middle of the tables: where the hand rests, out of the picture


@dataclasses.dataclass(frozen=True)
class Manner:
    """How the person moves; estimates. `speed` [m/s] varies by the factor `uneven`; `aim` [m] and `twist` [rad] are the
    standard deviations with which a place and a direction are missed; `drop` [m] is the height at which a box is let go;
    `tremor` [m]; `linger`: how likely the hand stays near after letting go instead of leaving the picture; `pause`: how
    likely it stops on the way, for up to `longest` [s]; `side`: on which side of the camera the person stands, +-1."""

    speed: float = 0.65
    uneven: float = 1.6
    aim: float = 0.0012
    twist: float = 0.05
    drop: float = 0.0005
    tremor: float = 0.0008
    linger: float = 0.3
    pause: float = 0.3
    longest: float = 0.8
    side: float = 1.0


class Demonstrator:
    """Do `steps` one after the other, each a box that is to be at a place in a frame as it is then; `advance` lets time
    pass. `time` [s]; `hand` is the pose of the hand in the world; `qpos` the state of the scene's model. `done` a moment
    after the last step."""

    def __init__(
        self, scene: TwinScene, steps: Sequence[Target], rng: np.random.Generator, manner: Manner | None = None
    ) -> None:
        self.scene, self.steps, self.manner = scene, steps, manner or Manner()
        self.time, self.done = 0.0, False
        self._rng = rng
        self._model = scene.model
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = scene.cell.qpos
        for arm, joints in scene.cell.joints.items():
            for names, actuators in (
                (joints, scene.cell.actuators[arm]),
                (scene.cell.finger_joints[arm], scene.cell.finger_actuators[arm]),
            ):
                for joint, actuator in zip(names, actuators, strict=True):
                    at = scene.model.joint(joint).qposadr[0]
                    self._data.ctrl[scene.model.actuator(actuator).id] = scene.cell.qpos[at]
        task = scene.task
        self._middle = np.mean([[*table.position[:2], table.top] for table in task.tables], axis=0)
        self._toward = np.array([*scene.camera.pose.translation[:2], 0.0]) - [*self._middle[:2], 0.0]
        self._toward /= np.linalg.norm(self._toward)
        self._phases = rng.uniform(0, 2 * math.pi, (len(TREMOR), 3))
        self._place = self._rest()
        self._held: str | None = None
        self._steady = 1.0  # share of the tremor
        self._turn = Rotation.identity()  # of what is held
        self._life = self._live()

    @property
    def qpos(self) -> Float[np.ndarray, " nq"]:
        return self._data.qpos

    @property
    def hand(self) -> RigidTransform:
        shoulder = self._rest() + 0.3 * self._toward
        x, y, _ = shoulder - self._place
        return RigidTransform.from_components(self._shaken(), Rotation.from_euler("z", math.atan2(y, x)))

    def poses(self) -> dict[str, RigidTransform]:
        """Return the true poses of the boxes in the world."""
        return box_poses(self.scene, self._data.qpos)

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK)):
            if next(self._life, None) is None:
                self.done = True
            self._step()
            self.time += TICK

    def _step(self) -> None:
        model, data = self._model, self._data
        for _ in range(round(TICK / model.opt.timestep)):
            if self._held is not None:
                joint = model.body(self._held).jntadr[0]
                at, speed = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
                data.qpos[at : at + 7] = [*self._shaken(), *self._turn.as_quat(scalar_first=True)]
                data.qvel[speed : speed + 6] = 0
            mujoco.mj_step(model, data)

    def _live(self) -> Iterator[bool]:
        yield from self._wait(1.2)
        for i, step in enumerate(self.steps):
            yield from self._carry(step)
            if i + 1 == len(self.steps) or self._rng.random() >= self.manner.linger:
                yield from self._go(self._rest())
                yield from self._wait(self._rng.uniform(0.3, 1.0))
        yield from self._wait(1.5)

    def _carry(self, step: Target) -> Iterator[bool]:
        box, up = self.poses()[step.object], np.array([0.0, 0.0, 1.0])
        yield from self._go(box.translation + HIGH * up)
        yield from self._go(box.translation)
        yield from self._wait(self._rng.uniform(0.1, 0.3))
        self._held, self._turn, self._place = step.object, box.rotation, box.translation.copy()
        yield from self._go(box.translation + HIGH * up)
        goal, turn = self._goal(step, box.rotation)
        if self._rng.random() < self.manner.pause:
            yield from self._go((self._place + goal) / 2 + HIGH * up)
            yield from self._wait(self._rng.uniform(0.2, self.manner.longest))
        yield from self._go([*goal[:2], max(self._place[2], goal[2] + HIGH / 2)], turn)
        yield from self._go(goal + self.manner.drop * up)
        for self._steady in np.linspace(1.0, RESTED, 10):
            yield True
        yield from self._wait(self._rng.uniform(0.1, 0.4))
        self._held, self._steady = None, 1.0
        yield from self._wait(self._rng.uniform(0.1, 0.3))
        yield from self._go(self._place + HIGH * (up + self._toward))

    def _goal(self, step: Target, held: Rotation) -> tuple[Point, Rotation]:
        """Return where the box is put down, about where it is meant to be, and how it is turned: square to what is there."""
        frames = {
            **self.poses(),
            **self.scene.kits,
            self.scene.task.robot_frame: RigidTransform.from_translation(self.scene.task.robot_position),
        }
        frame = frames[step.frame]
        off = self._rng.normal(0, self.manner.aim, 3) * [1, 1, 0]
        yaw = (frame.rotation.inv() * held).as_euler("ZYX")[0]
        rest = (yaw + math.pi / 4) % (math.pi / 2) - math.pi / 4
        turn = Rotation.from_euler("z", self._rng.normal(0, self.manner.twist) - rest)
        return frame.apply(step.position) + off, turn * held

    def _rest(self) -> Point:
        toward, aside, high = AWAY
        across = np.array([-self._toward[1], self._toward[0], 0.0])
        return self._middle + toward * self._toward + self.manner.side * aside * across + [0, 0, high]

    def _wait(self, seconds: float) -> Iterator[bool]:
        for _ in range(round(seconds / TICK)):
            yield True

    def _go(self, goal: Point | Sequence[float], turn: Rotation | None = None) -> Iterator[bool]:
        """Move along an arc at the pace of a hand (minimum jerk); turn what is held."""
        start, end = self._place.copy(), np.asarray(goal, float)
        pace = self.manner.speed * math.exp(self._rng.uniform(-1, 1) * math.log(self.manner.uneven))
        steps = max(20, round(1.9 * float(np.linalg.norm(end - start)) / pace / TICK))
        bend = self._rng.normal(0, 0.08, 3) * np.linalg.norm(end - start) * [1, 1, 0]
        first = self._turn
        by = Rotation.identity() if turn is None else turn * first.inv()
        for i in range(1, steps + 1):
            share = i / steps
            done = share**3 * (10 - 15 * share + 6 * share**2)
            self._place = start + done * (end - start) + math.sin(math.pi * done) ** 2 * bend
            self._turn = Rotation.from_rotvec(done * by.as_rotvec()) * first
            yield True

    def _shaken(self) -> Point:
        waves = [
            share * np.sin(2 * math.pi * rate * self.time + phase)
            for (rate, share), phase in zip(TREMOR, self._phases, strict=True)
        ]
        return self._place + self._steady * self.manner.tremor * np.sum(waves, axis=0)
