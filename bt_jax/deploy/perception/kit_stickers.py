"""Where the plate of a kit has room for markers: between its walls, and beside whatever may stand in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.tasks import Kit, Task
from bt_jax.tasks.slots import fits, slot_turn

__all__ = ["Sticker", "kit_stickers"]

MOST = 4  # on a kit
FILLED = 0.9  # of the edge of the free square that it lies in
LEAST = 0.02  # m: the markers of smaller ones are too hard to read
ROUGH = 0.003  # m by which objects may be beside their places
STEP = 0.001  # m between the middles that are tried


@dataclasses.dataclass(frozen=True)
class Sticker:
    """A square on a kit's plate: `middle` along the kit's x and y, and its `edge`, m."""

    name: str
    middle: tuple[float, float]
    edge: float


@dataclasses.dataclass(frozen=True)
class _Taken:
    """A rectangle of the plate: its middle and half its edges, m."""

    middle: tuple[float, float]
    half: tuple[float, float]


def kit_stickers(task: Task, kit: Kit) -> list[Sticker]:
    """Return the stickers of a kit: in its corners, as large as an object in its middle leaves free; in a kit with slots,
    the largest squares beside slots and dividers. Raise UserError if there is no room for one."""
    if not kit.places:
        return _in_corners(task, kit)
    taken = [*_objects(task, kit), *(_Taken(*wall) for wall in kit.walls())]
    stickers: list[Sticker] = []
    while len(stickers) < MOST and (free := _largest(kit, taken))[1] >= LEAST / FILLED / 2:
        middle, half = free
        stickers.append(Sticker(f"sticker_{len(stickers) + 1}", middle, 2 * FILLED * half))
        taken.append(_Taken(middle, (half, half)))
    if not stickers:
        others = ", its objects smaller, or leave out its dividers" if kit.dividers else " or its objects smaller"
        raise UserError(
            f"{kit.name} leaves no room for markers beside its slots, which take a square of {1000 * LEAST / FILLED:.0f} mm "
            f"at least; make the kit larger{others}"
        )
    return stickers


def _in_corners(task: Task, kit: Kit) -> list[Sticker]:
    beside = max(box.edge for box in task.objects) / 2
    edge = FILLED * (min(kit.inner) - beside)
    if edge <= 0:
        raise UserError(f"{kit.name} leaves no room for markers beside an object in its middle; make the kit larger")
    offset = [inner - edge / 2 for inner in kit.inner]
    corners = {"left_front": (-1, -1), "right_front": (1, -1), "left_back": (-1, 1), "right_back": (1, 1)}
    return [Sticker(name, (x * offset[0], y * offset[1]), edge) for name, (x, y) in corners.items()]


def _objects(task: Task, kit: Kit) -> Iterator[_Taken]:
    """Yield what objects may cover: those with targets in the kit, and in its other slots every one that fits."""
    halves = [
        (target.position[:2], task.thing(target.object).half_at(target.turn))
        for target in task.targets
        if target.frame == kit.name
    ]
    wanted = {target.slot for target in task.targets}
    halves += [
        (slot.position, thing.half_at(slot_turn(kit, slot, thing)))
        for slot in kit.places
        for thing in task.objects
        if f"{kit.name}.{slot.name}" not in wanted and fits(kit, slot, thing)
    ]
    for middle, (x, y, _) in halves:
        yield _Taken(middle, (x + ROUGH, y + ROUGH))


def _largest(kit: Kit, taken: list[_Taken]) -> tuple[tuple[float, float], float]:
    """Return the middle of the largest free square on the plate and half its edge, of several the one farthest from the
    kit's middle."""
    x, y = (np.arange(-inner, inner + STEP / 2, STEP) for inner in kit.inner)
    across, along = np.meshgrid(x, y, indexing="ij")
    free = np.minimum(kit.inner[0] - np.abs(across), kit.inner[1] - np.abs(along))
    for one in taken:
        free = np.minimum(free, _away(across, along, one))
    best = free >= free.max() - STEP / 2
    i, j = np.unravel_index(int(np.argmax(np.where(best, np.hypot(across, along), -1.0))), free.shape)
    return (float(across[i, j]), float(along[i, j])), float(free[i, j])


def _away(across: Float[np.ndarray, "X Y"], along: Float[np.ndarray, "X Y"], one: _Taken) -> Float[np.ndarray, "X Y"]:
    """Return half the edge of the square around each point that just touches a rectangle, negative inside of it."""
    return np.maximum(np.abs(across - one.middle[0]) - one.half[0], np.abs(along - one.middle[1]) - one.half[1])
