"""Buttons that carry and turn what is in the gripper step by step, and the size of a step."""

from __future__ import annotations

import functools
from collections.abc import Awaitable, Callable
from typing import Literal

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button
from bt_jax.app.state.directions import TURN_STEP, Direction, as_seen
from bt_jax.app.state.studio import Studio
from bt_jax.app.units import in_metres, in_millimetres

__all__ = ["MOVES", "TURNS", "GripperPad"]

MOVES: dict[str, Direction] = {
    "ArrowLeft": "left",
    "ArrowRight": "right",
    "ArrowUp": "away",
    "ArrowDown": "near",
    "PageUp": "up",
    "PageDown": "down",
}
TURNS: dict[str, Literal[-1, 1]] = {"q": 1, "e": -1}
PAD: tuple[tuple[Direction, str, str, str], ...] = (  # direction, icon, what it does, place in the grid
    ("away", "arrow_upward", "Away from you (arrow up)", "1 / 2"),
    ("left", "arrow_back", "To the left (arrow left)", "2 / 1"),
    ("near", "arrow_downward", "Towards you (arrow down)", "2 / 2"),
    ("right", "arrow_forward", "To the right (arrow right)", "2 / 3"),
    ("up", "keyboard_double_arrow_up", "Higher (page up)", "1 / 5"),
    ("down", "keyboard_double_arrow_down", "Lower (page down)", "2 / 5"),
)
TURN_PAD = (
    ("q", "rotate_left", f"Turn to the left by {TURN_STEP:g} degrees (Q)", "1 / 1"),
    ("e", "rotate_right", f"Turn to the right by {TURN_STEP:g} degrees (E)", "1 / 3"),
)


class GripperPad:
    """Built into the container that is open. Directions are as the person sees them, however the view is turned."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.page, self.teaching = page, studio.teaching
        self._guard = functools.partial(page.guard, steers="gripper")
        self._shown_step = self.teaching.step
        self._moves: list[ui.button] = []
        self._turns: list[ui.button] = []
        with ui.element("div").classes("teach-pad"):
            for direction, icon, text, place in PAD:
                carry = self._guard(self._mover(direction))
                self._moves.append(_key(f"demonstrate-{direction}", icon, text, place, carry))
            for key, icon, text, place in TURN_PAD:
                turn = self._guard(functools.partial(self.teaching.turn, TURNS[key]))
                self._turns.append(_key(f"demonstrate-turn-{key}", icon, text, place, turn))

    def build_step(self) -> None:
        """Build the size of a step into the container that is open."""
        guard, teaching = self._guard, self.teaching
        with ui.row().classes("items-center gap-1 no-wrap"):
            smaller = "flat round aria-label='Smaller step (-)' title='Smaller step (-)'"
            larger = "flat round aria-label='Larger step (+)' title='Larger step (+)'"
            button("", "demonstrate-smaller", "remove", guard(lambda: teaching.change_step(-1)), more=smaller)
            self.step = (
                ui.number("Step", value=in_millimetres(teaching.step), format="%g", suffix="mm")
                .props("dense outlined data-testid=demonstrate-step")
                .classes("teach-step")
            )
            self.step.on("change", guard(self._set_step))
            self.step.on("keydown.enter", js_handler="(event) => event.target.blur()")  # the keys carry again
            button("", "demonstrate-larger", "add", guard(lambda: teaching.change_step(1)), more=larger)

    def refresh(self, *, holds: bool, turns: bool) -> None:
        """Allow what can be done with what the gripper holds."""
        for move in self._moves:
            move.set_enabled(holds)
        for turn in self._turns:
            turn.set_enabled(turns)
        if self.teaching.step != self._shown_step:  # else a step that is being written would be lost
            self._shown_step = self.teaching.step
            self.step.set_value(in_millimetres(self.teaching.step))

    async def move(self, direction: Direction) -> None:
        """Carry the held object one step, as the person sees it."""
        await self.teaching.move(as_seen(direction, self.page.scene.quarter))

    def _mover(self, direction: Direction) -> Callable[[], Awaitable[None]]:
        return lambda: self.move(direction)

    def _set_step(self) -> None:
        value = self.step.value
        try:
            self.teaching.set_step(None if value is None else in_metres(value))
        except UserError:
            self.step.set_value(in_millimetres(self.teaching.step))
            raise


def _key(testid: str, icon: str, text: str, place: str, handler: Callable[..., Awaitable[None]]) -> ui.button:
    made = button("", testid, icon, handler, more="outline")
    made.props(f'aria-label="{text}" title="{text}"').style(f"grid-area: {place}")
    return made
