"""The person in the twin's cell: at random moments takes a box away, puts it elsewhere, or brings it back."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.planning.pose_geometry import stands_on, table_under
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.twin.cell import TwinScene, box_poses
from bt_jax.deploy.twin.controller import Controller
from bt_jax.tasks import Task

__all__ = ["Person", "PersonsHand", "Touch", "free_boxes", "tcp_points"]

AWAY = 0.12  # metres that the person keeps from the hands of the robot
GONE = (1.5, 8.0)  # seconds for which a box is taken away
OFF = (2.0, 0.0)  # where it is meanwhile, on the floor and out of the camera's view


@dataclasses.dataclass(frozen=True)
class Touch:
    """What the person did: "move", "push", "put", "remove" or "return"; or what else happened, a name of
    `twin.disturbances` or a fault."""

    time: float
    what: str
    box: str

    def __str__(self) -> str:
        words = {
            "move": "moves {}",
            "push": "pushes {}",
            "put": "puts {} elsewhere",
            "remove": "takes {} away",
            "return": "brings {} back",
        }
        return f"a person {words[self.what].format(self.box)}" if self.what in words else f"{self.what}: {self.box}"


class PersonsHand:
    """Moves boxes, takes them away and brings them back, and keeps away from the hands of the robot. `touches` are kept."""

    def __init__(self, scene: TwinScene, controller: Controller, rng: np.random.Generator) -> None:
        self.scene, self.controller, self.rng = scene, controller, rng
        self.touches: list[Touch] = []

    def free(self) -> list[str]:
        """Return the boxes that no hand is near and no other box stands on."""
        return free_boxes(self.scene.task, self.poses(), self._hands())

    def poses(self) -> dict[str, RigidTransform]:
        """Return where the boxes are, in the world."""
        return box_poses(self.scene, self.controller.state()[1])

    def move(self, now: float, box: str, what: str = "move") -> Touch | None:
        """Put a box on a free place of a table without a kit, None if there is none."""
        spot = self._spot(box)
        return None if spot is None else self._lay(now, what, box, spot)

    def take(self, now: float, box: str) -> Touch:
        """Take a box away."""
        height = self.scene.task.thing(box).height
        return self._lay(now, "remove", box, np.array([*OFF, self.scene.task.floor + height / 2]))

    def bring(self, now: float, box: str) -> Touch | None:
        """Bring a box back, as `move` does."""
        return self.move(now, box, "return")

    def lay(self, now: float, what: str, box: str, pose: RigidTransform) -> Touch:
        """Put a box to a pose in the world, whatever is there."""
        self.controller.put(box, pose)
        touch = Touch(now, what, box)
        self.touches.append(touch)
        return touch

    def _lay(self, now: float, what: str, box: str, spot: Point) -> Touch:
        turn = Rotation.from_euler("z", self.rng.uniform(-np.pi, np.pi))
        return self.lay(now, what, box, RigidTransform.from_components(spot, turn))

    def _spot(self, box: str) -> Point | None:
        """Return a free place on a table without a kit, away from other boxes and from the hands."""
        task, height = self.scene.task, self.scene.task.thing(box).height
        others = [pose.translation for name, pose in self.poses().items() if name != box]
        standing = [table_under(task, kit.translation) for kit in self.scene.kits.values()]
        tables = [table for table in task.tables if table not in standing]
        near = [*((other, task.layout.spacing) for other in others), *((hand, AWAY) for hand in self._hands())]
        for _ in range(100):
            table = tables[self.rng.integers(len(tables))]
            room = np.array(table.size[:2]) / 2 - task.layout.margin
            spot = np.array([*(np.array(table.position[:2]) + self.rng.uniform(-room, room)), table.top + height / 2])
            if all(np.linalg.norm((spot - thing)[:2]) > least for thing, least in near):
                return spot
        return None

    def _hands(self) -> list[Point]:
        return list(tcp_points(self.scene, self.controller.state()[1]).values())


class Person:
    """Touch a box at each of `times` [s], the first moment from then on at which one is free; never one that is in or near
    a hand, nor one with another on top."""

    def __init__(self, scene: TwinScene, controller: Controller, rng: np.random.Generator, times: list[float]) -> None:
        self.scene, self.rng = scene, rng
        self._hand = PersonsHand(scene, controller, rng)
        self._times = sorted(times)
        self._gone: dict[str, float] = {}  # box -> when it comes back

    @property
    def touches(self) -> list[Touch]:
        return self._hand.touches

    def __call__(self, now: float, shown: TickReport) -> Touch | None:
        """Return what the person does now, None if nothing."""
        for box, until in list(self._gone.items()):
            if now >= until and (touch := self._hand.bring(now, box)) is not None:
                del self._gone[box]
                return touch
        if not self._times or now < self._times[0]:
            return None
        free = [name for name in self._hand.free() if name not in self._gone]
        if not free:
            return None
        box = str(self.rng.choice(free))
        if self.rng.random() < 0.4:
            self._times.pop(0)
            self._gone[box] = now + self.rng.uniform(*GONE)
            return self._hand.take(now, box)
        touch = self._hand.move(now, box)
        if touch is not None:
            self._times.pop(0)
        return touch

    @property
    def done(self) -> bool:
        """Will there be nothing more?"""
        return not self._times and not self._gone


def free_boxes(task: Task, poses: Mapping[str, RigidTransform], hands: Collection[Point]) -> list[str]:
    """Return the boxes that no hand is near and no other box stands on. `poses` and `hands`, the points between the robot's
    fingers, are in the world."""
    return [
        name
        for name, pose in poses.items()
        if all(np.linalg.norm(pose.translation - hand) > AWAY for hand in hands)
        and not any(stands_on(task, other, name, poses) for other in poses)
    ]


def tcp_points(scene: TwinScene, qpos: Float[np.ndarray, " nq"]) -> dict[str, Point]:
    """Return the point between the fingers of each arm in the world, from a state of the model."""
    base = RigidTransform.from_translation(scene.task.robot_position)
    return {
        arm.name: (
            base * arm.forward(np.array([qpos[scene.model.joint(j).qposadr[0]] for j in arm.joint_names]))
        ).translation
        for arm in scene.robot.arms
    }
