"""A place in number fields: its reference, how far to the right, back and up, in millimetres, and how an object lies there,
in degrees."""

from __future__ import annotations

import asyncio
import dataclasses
import functools
from collections.abc import Awaitable, Callable, Collection, Sequence
from typing import Any

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.state.spots import Spot
from bt_jax.app.units import in_metres, in_millimetres
from bt_jax.app.widgets.context import PageContext

__all__ = ["PlaceFields"]

AXES = (("right", "right, mm"), ("away", "back, mm"), ("up", "up, mm"))
TURN = ("turn", "turned, °")
APPLY = ("blur", "keydown.enter", "keyup.up", "keyup.down")


class PlaceFields:
    """Number fields that call `moved(spot)` when a person has left one, pressed Enter or stepped with the arrow keys; after
    a UserError they show the place as it was. With `turns`, there is one for how the object lies; empty, with `any_turn`, if
    that does not matter."""

    def __init__(
        self,
        page: PageContext,
        name: str,
        references: Sequence[str],
        spot: Spot,
        moved: Callable[[Spot], Awaitable[None]],
        *,
        step: str = "task",
        turns: bool = False,
        any_turn: bool = False,
    ) -> None:
        self._name, self._moved, self._spot, self._any_turn = name, moved, spot, any_turn
        self._apply = page.guard(self._move)
        self._turn = asyncio.Lock()  # each number applies to the place that the ones before it have led to
        self._reference = (
            ui.select(list(references), value=spot.reference, label="measured from")
            .on("update:model-value", page.guard(self._change))
            .props(f"dense outlined options-dense data-testid={step}-reference-{name}")
            .classes("place-reference")
        )
        self._fields: dict[str, ui.number] = {}
        for axis, label in (*AXES, TURN) if turns else AXES:
            field = ui.number(label, step=1, format="%g").props(
                f'dense outlined data-testid={step}-{axis}-{name} aria-label="{name}, {label}"'
            )
            for event in APPLY:
                field.on(event, functools.partial(self._left, axis))
            self._fields[axis] = field.classes("place-number")
        if turns and any_turn:
            self._fields["turn"].props("placeholder=any stack-label")
        self._restore()

    def show(self, spot: Spot) -> None:
        """Show another place; a field that somebody is writing in stays if its value is the same."""
        before, self._spot = self._spot, spot
        if spot.reference != before.reference:
            self._restore()
        else:
            self._restore([axis for axis in self._fields if _shown(spot, axis) != _shown(before, axis)])

    def _restore(self, axes: Collection[str] | None = None) -> None:
        self._reference.set_value(self._spot.reference)
        for axis in self._fields if axes is None else axes:
            self._fields[axis].set_value(_shown(self._spot, axis))

    async def _left(self, axis: str) -> None:
        """Apply what was written into a field, if it is something else than before."""
        value = self._fields[axis].value
        written = None if value is None else round(value, 1 if axis == "turn" else None)
        async with self._turn:
            if written == _shown(self._spot, axis):
                return
            await self._apply(axis, written)
            if self._fields[axis].value in (value, written):
                self._restore([axis])

    async def _move(self, axis: str, written: float | None) -> None:
        if written is None and not (axis == "turn" and self._any_turn):
            unit = "degrees" if axis == "turn" else "millimetres"
            raise UserError(f"a number is missing for {self._name}; write how many {unit}")
        changed: dict[str, Any] = {axis: written if axis == "turn" or written is None else in_metres(written)}
        await self._moved(dataclasses.replace(self._spot, **changed))

    async def _change(self) -> None:
        """Measure from elsewhere, starting in the middle or on top: the same numbers would mean another place."""
        reference = self._reference.value
        async with self._turn:
            try:
                await self._moved(Spot(reference, 0.0, 0.0, 0.0, self._spot.turn))
            finally:
                self._restore([])


def _shown(spot: Spot, axis: str) -> float | None:
    """Return what a field says: millimetres, or degrees."""
    if axis == "turn":
        return None if spot.turn is None else round(spot.turn, 1) + 0.0
    return in_millimetres(getattr(spot, axis))
