"""What the numbers of tasks and demonstrations may be: the one table of bounds. They are wide; a number outside is a slip,
most often of the unit."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from bt_jax.tasks.things import Object

__all__ = ["BOUNDS", "NOISE", "POSITION", "Bound", "numbers", "out_of_bounds"]


@dataclasses.dataclass(frozen=True)
class Bound:
    """The least and the greatest value, in `unit`. `slip`: the unit that is written by mistake, and what it is in `unit`."""

    low: float
    high: float
    unit: str = ""
    slip: tuple[str, float] | None = None

    def complaint(self, value: float) -> str | None:
        """Return why a value is implausible, and what to write; None if it is plausible."""
        if self.low <= value <= self.high:
            return None
        remedy = f"write {self.low:g} to {self.high:g} {self.unit}".rstrip()
        if self.slip is not None and self.low <= value * self.slip[1] <= self.high:
            name = {"m": "metres? "}.get(self.unit, "")
            remedy += f" ({name}{value:g} {self.slip[0]} are {value * self.slip[1]:.3g} {self.unit}".rstrip() + ")"
        return f"{value:g} is implausible; {remedy}"


def _metres(low: float, high: float) -> Bound:
    return Bound(low, high, "m", ("mm", 0.001))


NOISE = _metres(0.0, 0.1)  # of a person who demonstrates
POSITION, LENGTH, GAP = _metres(-10.0, 10.0), _metres(0.0005, 2.0), _metres(0.0, 2.0)
TURN = Bound(-360.0, 360.0, "degrees")
CHANCE = Bound(0.0, 1.0, slip=("%", 0.01))
TICKS, COST = Bound(1.0, 10_000.0, "ticks"), Bound(0.0, 1e6)
BOUNDS: Mapping[str, Bound] = MappingProxyType(
    {  # key of a task, without the numbers of list entries
        "tables.position": POSITION,
        "tables.size": _metres(0.005, 10.0),
        "kits.position": POSITION,
        "kits.slots.position": POSITION,
        "kits.slots.turn": TURN,
        "kits.grid": Bound(1.0, 20.0),
        "kits.size": _metres(0.005, 2.0),
        "kits.thickness": LENGTH,
        "kits.wall_height": LENGTH,
        "kits.wall_thickness": LENGTH,
        "objects.size": _metres(0.005, 2.0),
        "objects.radius": _metres(0.0025, 1.0),
        "objects.height": _metres(0.005, 2.0),
        "objects.color": Bound(0.0, 1.0, slip=("of 255", 1 / 255)),
        "objects.density": Bound(10.0, 25_000.0, "kg/m³", ("g/cm³", 1000.0)),  # foam to osmium
        "targets.position": POSITION,
        "targets.turn": TURN,
        "layout.spacing": GAP,
        "layout.margin": GAP,
        "layout.turn": Bound(0.0, 180.0, "degrees"),
        "layout.fixed.position": POSITION,
        "layout.fixed.turn": TURN,
        "genes.gap": GAP,
        "genes.grid": Bound(0.0, 20.0),
        "genes.pitch": GAP,
        "genes.height": GAP,
        "episode.max_ticks": TICKS,
        "episode.success_ticks": TICKS,
        "episode.action_ticks": TICKS,
        "episode.tolerance": _metres(0.0001, 1.0),
        "episode.turn_tolerance": Bound(0.01, 45.0, "degrees"),
        "weights.distance": COST,
        "weights.node": COST,
        "weights.timeout": COST,
        "weights.failure": COST,
        "weights.subgoal": COST,
        "weights.turn": COST,
        "weights.travel": COST,
        "robot_position": POSITION,
        "gripper_opening": _metres(0.005, 2.0),
        "finger_room": GAP,
        "faults.slip": CHANCE,
        "faults.drop": CHANCE,
        "faults.jam": CHANCE,
        "faults.place_spread": _metres(0.0, 0.1),
        "faults.turn_spread": Bound(0.0, 45.0, "degrees"),
        "faults.hide": CHANCE,
        "faults.hide_ticks": TICKS,
        "faults.move": CHANCE,
        "faults.take": CHANCE,
        "faults.take_ticks": TICKS,
        "faults.heavy": CHANCE,
        "faults.heavy_slip": CHANCE,
        "robot.base.reach": _metres(0.05, 5.0),
        "robot.base.radius": _metres(0.01, 2.0),
        "robot.base.step": _metres(0.05, 10.0),
        "robot.base.stations": POSITION,
    }
)


def out_of_bounds(thing: Any) -> Iterator[tuple[str, str]]:
    """Yield the keys, and the complaints, of all implausible numbers in a task."""
    for key, name, value in numbers(thing, "", ""):
        bound = BOUNDS.get(name)
        if bound is not None and (complaint := bound.complaint(value)) is not None:
            yield key, complaint


def numbers(value: Any, key: str, name: str) -> Iterator[tuple[str, str, float]]:
    """Yield the key, the key without the numbers of list entries, and the value of every number; of a cylinder its radius
    and its height, as people write them."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield key, name, float(value)
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from numbers(item, f"{key}[{i}]", name)
    elif dataclasses.is_dataclass(value):
        dot = "." if key else ""
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        if isinstance(value, Object) and value.shape == "cylinder":
            del fields["size"]
            fields |= {"radius": value.size[0] / 2, "height": value.height}
        for field, inner in fields.items():
            yield from numbers(inner, f"{key}{dot}{field}", f"{name}{dot}{field}")
