"""What is done to the twin's cell when something goes wrong: boxes, the kit, unknown objects and pictures change."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.twin.cell import STRANGER, TwinScene, box_poses
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.person import AWAY, OFF, Touch, tcp_points
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.deploy.twin.settings import Realism
from bt_jax.deploy.twin.triggers import Moment, Trigger

__all__ = ["Disturbance", "Disturber"]

EARLY = 0.6  # s after a hand has set out
CARRIED = 1.0  # s for which a box is carried before it is lost
TURN = 0.7  # rad: a box is then wider than the fingers open
SHIFT = 0.04  # m by which the kit is moved
LEVEL = 0.012  # m: two boxes with centres this near in height stand on the same level


@dataclasses.dataclass(frozen=True)
class Disturbance:
    """`act` is a method of `Disturber`, called at every tick until it returns what it was done to; None if the cell is so
    from the start. `stranger` as for `build_scene`, `realism` are values of `Realism`."""

    act: Callable[[Disturber, Moment], str | None] | None = None
    stranger: str | None = None
    realism: Mapping[str, object] = dataclasses.field(default_factory=dict)

    def change(self, realism: Realism) -> Realism:
        """Return how real the cell is."""
        return dataclasses.replace(realism, **self.realism)  # type: ignore[arg-type]


class Disturber:
    """Does one thing to the cell of a run, once. `scene` is the scene as it is afterwards, `what` the name of the
    disturbance."""

    def __init__(
        self,
        what: str,
        disturbance: Disturbance,
        scene: TwinScene,
        controller: Controller,
        camera: RenderedCamera | None,
        rng: np.random.Generator,
        start: float,
    ) -> None:
        self.what, self.disturbance, self.start = what, disturbance, start
        self.scene, self.controller, self.rng = scene, controller, rng
        self._camera = camera
        self.touches: list[Touch] = []
        self.trigger = Trigger(rng)

    def __call__(self, now: float, shown: TickReport) -> Touch | None:
        """Return what happens now, None if nothing."""
        act = self.disturbance.act
        if self.touches:
            return None
        qpos = self.controller.state()[1]
        moment = Moment(now - self.start, shown, box_poses(self.scene, qpos), tcp_points(self.scene, qpos))
        done = "the cell" if act is None else act(self, moment)
        if done is None:
            return None
        self.touches.append(Touch(now, self.what, done))
        return self.touches[-1]

    @property
    def camera(self) -> RenderedCamera:
        """The camera. Raise UserError in real time, where it belongs to another thread."""
        if self._camera is None:
            raise UserError(f"'{self.what}' needs simulated time; leave out --realtime")
        return self._camera

    def swap(self, moment: Moment) -> str | None:
        """Swap two boxes that stand on the same level."""
        free = moment.free(self.scene.task) if self.trigger.due(moment) else []
        for i, one in enumerate(free):
            for other in free[i + 1 :]:
                if abs(moment.boxes[one].translation[2] - moment.boxes[other].translation[2]) < LEVEL:
                    self.controller.put(one, moment.boxes[other])
                    self.controller.put(other, moment.boxes[one])
                    return f"{one} and {other}"
        return None

    def turn_early(self, moment: Moment) -> str | None:
        """Turn a box as soon as a hand is on its way to it."""
        box = self.trigger.chosen(moment.doing("pick"))
        if box is None or not self.trigger.lasted(moment, EARLY):
            return None
        return self._turned(box, moment)

    def turn_late(self, moment: Moment) -> str | None:
        """Turn a box under the descending hand."""
        box = self.trigger.descended_on(moment)
        return None if box is None else self._turned(box, moment)

    def steal(self, moment: Moment) -> str | None:
        """Take a box away for good from where a hand is about to close around it."""
        box = self.trigger.descended_on(moment)
        if box is not None:
            self.controller.put(
                box,
                RigidTransform.from_translation([*OFF, self.scene.task.floor + self.scene.task.thing(box).height / 2]),
            )
        return box

    def lose(self, moment: Moment) -> str | None:
        """Let a box that is carried fall out of the fingers."""
        box = self.trigger.chosen(moment.doing("place"))
        if box is None or moment.shown.seen.holding != box or not self.trigger.lasted(moment, CARRIED):
            return None
        pose = moment.boxes[box]
        lowest = min(table.top for table in self.scene.task.tables) + self.scene.task.thing(box).height / 2
        below = [*pose.translation[:2], max(pose.translation[2] - 0.07, lowest)]
        self.controller.put(box, RigidTransform.from_components(below, pose.rotation))
        return box

    def add_beside(self, moment: Moment) -> str | None:
        """Put an unknown object where a finger will go, as soon as the hand is on its way."""
        return self._add(moment, lambda box: np.array([self.scene.task.thing(box).size[0], 0, 0]))

    def add_on(self, moment: Moment) -> str | None:
        """Put an unknown object on the box that the hand is on its way to."""
        return self._add(moment, lambda box: np.array([0, 0, self.scene.task.thing(box).height]))

    def add_twin(self, moment: Moment) -> str | None:
        """Put an object with the markers of one of the boxes on a table."""
        if not self.trigger.due(moment):
            return None
        thing = self.scene.task.objects[0]
        size = thing.edge
        for table in self.scene.task.tables:
            for x, y in ((0.05, 0.0), (-0.05, 0.0), (0.0, 0.05), (0.0, -0.05)):
                spot = np.array([table.position[0] + x, table.position[1] + y, table.top + thing.height / 2])
                near = [*moment.hands.values(), *(pose.translation for pose in moment.boxes.values())]
                at_kit = [
                    np.all(np.abs(spot - self.scene.kits[kit.name].translation)[:2] < np.array(kit.half) + size)
                    for kit in self.scene.task.kits
                ]
                if not any(at_kit) and all(np.linalg.norm(spot - place) > 2 * size for place in near):
                    self.controller.put(STRANGER, RigidTransform.from_translation(spot))
                    return str(self.disturbance.stranger)
        return None

    def lay_on_side(self, moment: Moment) -> str | None:
        """Lay a box on another of its faces."""
        free = moment.free(self.scene.task) if self.trigger.due(moment) else []
        if not free:
            return None
        box = str(self.rng.choice(free))
        turn = Rotation.from_euler("zx", [self.rng.uniform(-np.pi, np.pi), np.pi / 2])
        self.controller.put(box, RigidTransform.from_components(moment.boxes[box].translation, turn))
        return box

    def move_kit(self, moment: Moment) -> str | None:
        """Move the first kit, with what stands on it, while no hand is near."""
        kit = self.scene.kit
        near = 2 * AWAY
        if not self.trigger.due(moment) or any(
            np.linalg.norm(hand - kit.translation) < near for hand in moment.hands.values()
        ):
            return None
        middle = np.array([*np.mean([table.position[:2] for table in self.scene.task.tables], axis=0), 0])
        way = (middle - kit.translation) * [0, 1, 0]
        way = way / np.linalg.norm(way) if np.linalg.norm(way) > SHIFT else np.array([0.0, 1.0, 0.0])
        shift = RigidTransform.from_translation(SHIFT * way)
        for box, pose in moment.boxes.items():
            if np.all(np.abs(pose.translation - kit.translation)[:2] < self.scene.task.kits[0].half):
                self.controller.put(box, shift * pose)
        name = self.scene.task.kit_names[0]
        self.scene = dataclasses.replace(self.scene, kits={**self.scene.kits, name: shift * kit})
        self.controller.put(name, self.scene.kit)
        self.camera.move(name, self.scene.kit)
        return name

    def cover_kit(self, moment: Moment) -> str | None:
        """Cover the markers of the first kit."""
        if not self.trigger.due(moment):
            return None
        name = self.scene.task.kit_names[0]
        self.camera.cover(name)
        return name

    def _turned(self, box: str, moment: Moment) -> str:
        pose = moment.boxes[box]
        turn = Rotation.from_euler("z", TURN) * pose.rotation
        self.controller.put(box, RigidTransform.from_components(pose.translation, turn))
        return box

    def _add(self, moment: Moment, offset: Callable[[str], Point]) -> str | None:
        box = self.trigger.chosen(moment.doing("pick"))
        if box is None or not self.trigger.lasted(moment, EARLY):
            return None
        self.controller.put(STRANGER, moment.boxes[box] * RigidTransform.from_translation(offset(box)))
        return box
