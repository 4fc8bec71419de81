"""Films of moved boxes without a camera: pose tracks with noise and gaps, made into sightings."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.tasks import Task, load_task
from bt_jax.teaching.watch.moves import Watched
from bt_jax.teaching.watch.sighting import Seen, Sighting
from bt_jax.teaching.watch.watcher import Event, Watcher

TASK = load_task("yumi_stack")
KIT = TASK.kits[0].name
STEP = 0.1  # seconds between images
PLACES: Mapping[str, tuple[float, float, float]] = {
    KIT: (0.3, 0.0, 0.001),
    "YellowBox": (0.27, 0.21, 0.02),
    "GreenBox": (0.33, -0.2, 0.02),
    "BlueBox": (0.28, -0.29, 0.02),
}
IN_KIT, ON_YELLOW, ON_GREEN = (0.3, 0.0, 0.022), (0.3, 0.0, 0.062), (0.3, 0.0, 0.102)


@dataclasses.dataclass
class Table:
    """The scene of a film: where everything is, what is hidden and what is covered, and how badly it is measured."""

    rng: np.random.Generator = dataclasses.field(default_factory=lambda: np.random.default_rng(0))
    noise: float = 0.0005
    lost: float = 0.0  # share of the measurements that are missing by chance
    step: float = STEP
    task: Task = TASK
    time: float = 0.0
    poses: dict[str, RigidTransform] = dataclasses.field(
        default_factory=lambda: {name: RigidTransform.from_translation(place) for name, place in PLACES.items()}
    )
    hidden: set[str] = dataclasses.field(default_factory=set)
    covered: set[str] = dataclasses.field(default_factory=set)

    def put(self, name: str, place: Sequence[float], *, degrees: float = 0.0) -> None:
        turn = Rotation.from_euler("z", degrees, degrees=True)
        self.poses[name] = RigidTransform.from_components(place, turn)

    def look(self) -> Sighting:
        """The next image."""
        self.time += self.step
        bodies = {}
        for name, pose in self.poses.items():
            if name in self.hidden or self.rng.random() < self.lost:
                continue
            off = RigidTransform.from_components(
                self.rng.normal(0, self.noise, 3), Rotation.from_rotvec(self.rng.normal(0, 5 * self.noise, 3))
            )
            measured = RigidTransform.from_components(pose.translation + off.translation, off.rotation * pose.rotation)
            bodies[name] = Seen(measured, max(self.noise, 0.0003), name in self.covered)
        return Sighting(self.time, bodies)

    def wait(self, seconds: float) -> Iterator[Sighting]:
        for _ in range(round(seconds / self.step)):
            yield self.look()

    def carry(
        self, name: str, place: Sequence[float], *, seconds: float = 1.5, unseen: bool = False, degrees: float = 0.0
    ) -> Iterator[Sighting]:
        """A box goes to a place through the air, in sight or hidden by the hand, which covers it at both ends."""
        start = self.poses[name].translation
        steps = max(2, round(seconds / self.step))
        for i in range(steps + 1):
            share = i / steps
            lift = np.array([0.0, 0.0, 0.4 * share * (1 - share)])
            self.put(name, (1 - share) * start + share * np.array(place) + lift, degrees=share * degrees)
            if unseen:
                self.hidden.add(name)
            self.covered.add(name)
            yield self.look()
        self.hidden.discard(name)
        yield from self.wait(0.3)
        self.covered.discard(name)
        yield from self.wait(1.0)


def watch(film: Iterator[Sighting], watcher: Watcher | None = None) -> tuple[list[Event], Watched]:
    """What a watcher says of a film, and what it has seen."""
    watcher = watcher or Watcher(TASK)
    events = [event for sighting in film for event in watcher.update(sighting)]
    last, watched = watcher.finish()
    return [*events, *last], watched
