"""A person in the twin's cell who does what somebody says while a tree runs, also by pointing at the camera's picture."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Literal

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.planning.grasps import yaw_of
from bt_jax.deploy.planning.pose_geometry import stands_on, table_under
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.twin.cell import Qpos, TwinScene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.person import OFF, PersonsHand, Touch

__all__ = ["InstructedPerson", "Instruction", "Pointer"]

PUSH = 0.05  # m by which a push moves an object
CLICK = 0.02  # share of the picture below which a drag is a click
FLAT = 0.004  # m from an object's top within which it is pointed at from above
DROP = 0.001  # m above its place at which an object is let go
GONE = 0.3  # m from where what is taken away lies, within which an object is away

Share = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Instruction:
    """What to do with the object `box`; or "carry", from the place `start` of the camera's picture to `end`, each in
    shares of its width and height from the top left. Carried off the tables, an object is taken away; carried nowhere,
    it is pushed."""

    what: Literal["push", "remove", "return", "carry"]
    box: str = ""
    start: Share = (0.0, 0.0)
    end: Share = (0.0, 0.0)


class Pointer:
    """What is at a place of the camera's picture."""

    def __init__(self, scene: TwinScene) -> None:
        self.scene, self._data = scene, mujoco.MjData(scene.model)

    def __call__(self, qpos: Qpos, share: Share, *, through: str = "") -> tuple[str, Point] | None:
        """Return the body there and the point of it in the world, as if there were no body `through`; None for nothing."""
        model, camera = self.scene.model, self.scene.camera
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(model, self._data)
        pixel = np.array([share[0] * camera.width - 0.5, share[1] * camera.height - 0.5, 1.0])
        ray = camera.pose.rotation.apply(np.linalg.solve(camera.matrix, pixel))
        eye, hit = camera.pose.translation, np.zeros(1, np.int32)
        without = model.body(through).id if through else -1
        distance = mujoco.mj_ray(model, self._data, eye, ray, None, True, without, hit)
        if distance < 0:
            return None
        return model.body(int(model.geom_bodyid[hit[0]])).name, eye + distance * ray


class InstructedPerson:
    """Carry out the instructions that have come since the last tick. What cannot be done is refused: `answer` is called
    with a sentence. An object in or near a robot's hand, or with another on top, is never touched."""

    def __init__(
        self,
        scene: TwinScene,
        controller: Controller,
        rng: np.random.Generator,
        instructions: Callable[[], Iterable[Instruction]],
        answer: Callable[[str], None],
    ) -> None:
        self.scene, self.controller, self.rng = scene, controller, rng
        self._instructions, self._answer = instructions, answer
        self._hand, self._point = PersonsHand(scene, controller, rng), Pointer(scene)

    @property
    def touches(self) -> list[Touch]:
        return self._hand.touches

    @property
    def away(self) -> list[str]:
        """The objects that are away from the cell."""
        return [name for name, pose in self._hand.poses().items() if _is_away(pose)]

    def __call__(self, now: float, shown: TickReport) -> Touch | None:
        """Return what the person did last in this tick, None if nothing."""
        done = None
        for instruction in self._instructions():
            try:
                done = self._do(now, instruction)
            except UserError as refusal:
                self._answer(str(refusal))
        return done

    def _do(self, now: float, instruction: Instruction) -> Touch:
        if instruction.what == "carry":
            return self._carry(now, instruction)
        box, poses = instruction.box, self._hand.poses()
        if instruction.what == "return":
            if box not in poses or not _is_away(poses[box]):
                raise UserError(f"{box or 'it'} is not away; take it away first")
            return _placed(self._hand.bring(now, box), box)
        self._check_free(box, poses)
        return self._hand.take(now, box) if instruction.what == "remove" else self._push(now, box, poses)

    def _carry(self, now: float, instruction: Instruction) -> Touch:
        qpos, poses = self.controller.state()[1], self._hand.poses()
        grasped = self._point(qpos, instruction.start)
        if grasped is None or grasped[0] not in poses:
            raise UserError("there is no object at that place of the picture; begin on one that you see")
        box = grasped[0]
        self._check_free(box, poses)
        if math.dist(instruction.start, instruction.end) < CLICK:
            return self._push(now, box, poses)
        found = self._point(qpos, instruction.end, through=box)
        if found is None or table_under(self.scene.task, found[1]) is None:
            return self._hand.take(now, box)
        return self._hand.lay(now, "put", box, self._pose_at(box, poses, *found))

    def _pose_at(self, box: str, poses: Mapping[str, RigidTransform], on: str, point: Point) -> RigidTransform:
        """Return where an object stands that is put down at a point of a body, or in the middle of an object's top."""
        task = self.scene.task
        if on not in (*poses, *task.kit_names, "world"):
            raise UserError("the robot's arm is there; wait until it has gone, or choose another place")
        height, spot = task.thing(box).height, point
        if on in poses:
            if point[2] < poses[on].translation[2] + task.thing(on).height / 2 - FLAT:
                raise UserError(f"{on} is there; choose a free place, or its top")
            spot = np.array([*poses[on].translation[:2], point[2]])
        for name in self._beside(box, spot, poses):
            if name != on:
                raise UserError(f"{name} is there; choose a place with more room")
        if on not in poses and (rim := self._on_rim(box, spot)):
            raise UserError(f"the rim of {rim} is there; choose a place inside or beside it")
        top = np.array([0.0, 0.0, height / 2 + DROP])
        return RigidTransform.from_components(spot + top, Rotation.from_euler("z", yaw_of(poses[box].rotation)))

    def _push(self, now: float, box: str, poses: Mapping[str, RigidTransform]) -> Touch:
        """Move an object a little where it stands or, if there is no room, to a free place elsewhere."""
        pose, task = poses[box], self.scene.task
        table = table_under(task, pose.translation)
        for angle in self.rng.permutation(16) * np.pi / 8:
            spot = pose.translation + PUSH * np.array([math.cos(angle), math.sin(angle), 0.0])
            if table is None or table_under(task, spot + (spot - pose.translation)) is not table:
                continue
            if not self._on_rim(box, spot) and not self._beside(box, spot, poses):
                return self._hand.lay(now, "push", box, RigidTransform.from_components(spot, pose.rotation))
        return _placed(self._hand.move(now, box, "push"), box)

    def _beside(self, box: str, spot: Point, poses: Mapping[str, RigidTransform]) -> list[str]:
        """Return the objects that one at a place might touch, seen from above."""
        return [
            name
            for name, pose in poses.items()
            if name != box
            and float(np.linalg.norm((pose.translation - spot)[:2])) < self._round(box) + self._round(name)
        ]

    def _on_rim(self, box: str, spot: Point) -> str:
        """Return the kit whose walls an object at a place might touch, "" if there is none."""
        radius = self._round(box)
        for kit in self.scene.task.kits:
            away = np.abs(spot - self.scene.kits[kit.name].translation)[:2]
            if np.all(away < np.array(kit.half) + radius) and not np.all(away < np.array(kit.inner) - radius):
                return kit.name
        return ""

    def _round(self, box: str) -> float:
        """Return the radius of the circle around an object, seen from above."""
        return math.hypot(*self.scene.task.thing(box).size[:2]) / 2

    def _check_free(self, box: str, poses: Mapping[str, RigidTransform]) -> None:
        if box not in poses:
            raise UserError(f"there is no object '{box}'; choose one of {', '.join(poses)}")
        if _is_away(poses[box]):
            raise UserError(f"{box} is away; bring it back first")
        above = [other for other in poses if stands_on(self.scene.task, other, box, poses)]
        if above:
            raise UserError(f"{above[0]} stands on {box}; move that first")
        if box not in self._hand.free():
            raise UserError(f"the robot's hand is at {box}; wait until it has gone")


def _is_away(pose: RigidTransform) -> bool:
    return float(np.linalg.norm(pose.translation[:2] - OFF)) < GONE


def _placed(touch: Touch | None, box: str) -> Touch:
    if touch is None:
        raise UserError(f"there is no room for {box} on the tables; take something away first")
    return touch
