"""A place in number fields: what it is measured from, and how far to the right, back and up, in centimetres."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import TYPE_CHECKING

from nicegui import ui

from bt_jax.app.spots import Spot
from bt_jax.errors import UserError

if TYPE_CHECKING:
    from bt_jax.app.page import Page

__all__ = ["PlaceFields"]

AXES = (("right", "right, cm"), ("away", "back, cm"), ("up", "up, cm"))
APPLY = ("blur", "keydown.enter", "keyup.up", "keyup.down")


class PlaceFields:
    """Calls `moved(spot)` when a person has left a field, pressed Enter or stepped with the arrow keys; a UserError from it
    is said, and the fields show again what is."""

    def __init__(
        self,
        page: Page,
        name: str,
        references: Sequence[str],
        spot: Spot,
        moved: Callable[[Spot], Awaitable[None]],
        *,
        step: str = "task",
    ) -> None:
        self._name, self._moved, self._spot = name, moved, spot
        self._reference = (
            ui.select(list(references), value=spot.reference, label="measured from")
            .on("update:model-value", page.guard(self._change))
            .props(f"dense outlined options-dense data-testid={step}-reference-{name}")
            .classes("place-reference")
        )
        self._fields: dict[str, ui.number] = {}
        for axis, label in AXES:
            field = ui.number(label, step=1, format="%.1f").props(f"dense outlined data-testid={step}-{axis}-{name}")
            for event in APPLY:
                field.on(event, page.guard(self._apply))
            self._fields[axis] = field.classes("place-number")
        self._restore()

    def show(self, spot: Spot) -> None:
        """The fields show another place; what somebody is writing stays where it is still the same."""
        if spot != self._spot:
            self._spot = spot
            self._restore()

    def _restore(self) -> None:
        spot = self._spot
        self._reference.set_value(spot.reference)
        for axis, field in self._fields.items():
            field.set_value(_centimetres(spot, axis))

    async def _apply(self) -> None:
        values = {axis: field.value for axis, field in self._fields.items()}
        if values == {axis: _centimetres(self._spot, axis) for axis in values}:
            return
        if None in values.values():
            self._restore()
            raise UserError(f"a number is missing for {self._name}; write how many centimetres")
        metres = {
            axis: getattr(self._spot, axis) if value == _centimetres(self._spot, axis) else value / 100
            for axis, value in values.items()
        }
        await self._move(Spot(self._spot.reference, **metres))

    async def _change(self) -> None:
        """The same numbers from elsewhere would mean another place: it begins in the middle, or on top."""
        await self._move(Spot(self._reference.value, 0.0, 0.0, 0.0))

    async def _move(self, spot: Spot) -> None:
        try:
            await self._moved(spot)
        except UserError:
            self._restore()
            raise


def _centimetres(spot: Spot, axis: str) -> float:
    return round(100 * getattr(spot, axis), 1) + 0.0
