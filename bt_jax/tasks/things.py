"""What a scene holds: tables, kits with their slots, and the objects that the robot can move. Lengths are metres."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Literal

__all__ = ["Kit", "Object", "Shape", "Slot", "Table", "Vec2", "Vec3"]

Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Shape = Literal["cuboid", "cylinder"]


@dataclasses.dataclass(frozen=True)
class Table:
    """A fixed block; objects and kits stand on its top. `position` is its centre in the world."""

    name: str
    position: Vec3
    size: Vec3

    @property
    def top(self) -> float:
        return self.position[2] + self.size[2] / 2


@dataclasses.dataclass(frozen=True)
class Slot:
    """A named place in a kit: `position` is its middle, along the kit's x and y. An object in it is turned by `turn` degrees
    about the vertical. `takes` names the object or the part that it is for; it is for any where that is empty."""

    name: str
    position: Vec2
    turn: float = 0.0
    takes: str = dataclasses.field(default="", metadata={"written": "for"})


@dataclasses.dataclass(frozen=True)
class Kit:
    """An open tray: a plate with four walls standing on its edge. Its frame is at the plate's centre.

    `size` is its extent along x and y, `table` the table on which it stands, empty where the layout says it, and `position`
    is where it stands, seen from the middle of the table's top. A `grid` of rows and columns is as many slots of equal size,
    row by row from the low x and y, called r1c1, r1c2, ...; with `dividers`, walls as high as the outer ones lie between
    them.
    """

    name: str = "KittingBox"
    size: Vec2 = (0.4, 0.4)
    thickness: float = 0.005
    wall_height: float = 0.04
    wall_thickness: float = 0.005
    table: str = ""
    position: Vec2 = (0.0, 0.0)
    slots: tuple[Slot, ...] = ()
    grid: tuple[int, int] | None = None
    dividers: bool = False

    @property
    def inner(self) -> Vec2:
        """Half the widths between opposite walls."""
        return self.size[0] / 2 - self.wall_thickness, self.size[1] / 2 - self.wall_thickness

    @property
    def half(self) -> Vec2:
        """Half the size."""
        return self.size[0] / 2, self.size[1] / 2

    @property
    def plate(self) -> float:
        """Height of the plate's top over the kit's frame."""
        return self.thickness / 2

    @property
    def rim(self) -> float:
        """Height of the walls' tops over the kit's frame."""
        return self.thickness / 2 + self.wall_height

    @property
    def places(self) -> tuple[Slot, ...]:
        """All slots, those of the grid included."""
        if self.grid is None:
            return self.slots
        rows, columns = self.grid
        xs = [_middle(self.inner[0], columns, column) for column in range(columns)]
        ys = [_middle(self.inner[1], rows, row) for row in range(rows)]
        cells = [Slot(f"r{i + 1}c{j + 1}", (x, y)) for i, y in enumerate(ys) for j, x in enumerate(xs)]
        return (*self.slots, *cells)

    def room(self, slot: Slot) -> Vec2:
        """Return half the widths between the walls around the middle of a slot."""
        (x, y), half = slot.position, [self.inner[0], self.inner[1]]
        room = [half[0] - abs(x), half[1] - abs(y)]
        if self.grid is not None and self.dividers:
            rows, columns = self.grid
            for axis, count, at in ((0, columns, x), (1, rows, y)):
                walls = [half[axis] * (2 * i / count - 1) for i in range(1, count)]
                room[axis] = min([room[axis], *(abs(at - wall) - self.wall_thickness / 2 for wall in walls)])
        return room[0], room[1]

    def walls(self) -> Iterator[tuple[Vec2, Vec2]]:
        """Yield middle and half extents, along x and y, of every wall: left, right, front, back, then the dividers between
        columns and those between rows."""
        (x, y), half = self.half, self.wall_thickness / 2
        yield (half - x, 0.0), (half, y)
        yield (x - half, 0.0), (half, y)
        yield (0.0, half - y), (x - 2 * half, half)
        yield (0.0, y - half), (x - 2 * half, half)
        if self.grid is not None and self.dividers:
            rows, columns = self.grid
            for column in range(1, columns):
                yield (self.inner[0] * (2 * column / columns - 1), 0.0), (half, self.inner[1])
            for row in range(1, rows):
                yield (0.0, self.inner[1] * (2 * row / rows - 1)), (self.inner[0], half)


def _middle(inner: float, count: int, index: int) -> float:
    """Return the middle of one of equal intervals between -inner and inner."""
    return round(inner * ((2 * index + 1) / count - 1), 6) + 0.0


@dataclasses.dataclass(frozen=True)
class Object:
    """Something that the robot can move: a cuboid, or a cylinder that stands upright. `size` is its extent along its own x,
    y and z, `color` is RGB in 0..1. Objects of one `part` are its instances and interchangeable; an object that is none
    has an empty one."""

    name: str
    size: Vec3
    color: Vec3
    density: float = 1000.0
    shape: Shape = "cuboid"
    part: str = ""

    @property
    def edge(self) -> float:
        """The longest edge."""
        return max(self.size)

    @property
    def height(self) -> float:
        return self.size[2]

    @property
    def is_cube(self) -> bool:
        return self.shape == "cuboid" and len(set(self.size)) == 1

    @property
    def symmetry(self) -> float:
        """The angle, in degrees about the vertical, after which it looks alike; 0 if it does after every angle."""
        if self.shape == "cylinder":
            return 0.0
        return 90.0 if self.size[0] == self.size[1] else 180.0

    def half_at(self, turn: float | None) -> Vec3:
        """Return half its extents along the axes of a frame in which it stands upright, turned by `turn` degrees (default 0)
        about the vertical."""
        x, y, z = (edge / 2 for edge in self.size)
        if turn is None or self.shape == "cylinder" or turn % 180 == 0:
            return x, y, z
        if turn % 90 == 0:
            return y, x, z
        c, s = abs(math.cos(math.radians(turn))), abs(math.sin(math.radians(turn)))
        return c * x + s * y, s * x + c * y, z

    @property
    def radius(self) -> float:
        """Of the sphere around it."""
        return math.hypot(*self.size) / 2 if self.shape == "cuboid" else math.hypot(self.size[0], self.size[2]) / 2

    @property
    def reach(self) -> float:
        """Of the circle around it, seen from above while it stands upright."""
        return self.size[0] / 2 if self.shape == "cylinder" else math.hypot(*self.size[:2]) / 2

    @property
    def volume(self) -> float:
        return math.prod(self.size) * (math.pi / 4 if self.shape == "cylinder" else 1.0)

    @property
    def mass(self) -> float:
        """In kilograms."""
        return self.density * self.volume

    @property
    def body(self) -> tuple[Shape, Vec3, float]:
        """All that the physics depends on; equal bodies move alike."""
        return self.shape, self.size, self.density

    @property
    def measures(self) -> str:
        """Its extents in millimetres, for people."""
        if self.shape == "cylinder":
            return f"{1000 * self.size[0]:g} mm across, {1000 * self.size[2]:g} mm high"
        edges = [self.size[0]] if self.is_cube else self.size
        return f"{' x '.join(f'{1000 * edge:g}' for edge in edges)} mm"
