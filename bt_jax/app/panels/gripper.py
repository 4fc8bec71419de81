"""The gripper in step 3: its buttons and keys, where it is, and what was done with it."""

from __future__ import annotations

import functools
from collections.abc import Awaitable, Callable
from typing import Literal

import numpy as np
from nicegui import ui
from nicegui.events import GenericEventArguments

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.destinations import Destinations
from bt_jax.app.panels.parts import button, css_color, heading, known
from bt_jax.app.plain_words import slot_at
from bt_jax.app.state.directions import TURN_STEP, Direction
from bt_jax.app.state.studio import Studio
from bt_jax.app.units import in_metres, in_millimetres, length
from bt_jax.app.widgets.dialogs import ask
from bt_jax.app.widgets.scene_view import Ghost
from bt_jax.teaching.teleoperation import Landing, Teleoperation

__all__ = ["GripperControls"]

MOVES: dict[str, Direction] = {
    "ArrowLeft": "left",
    "ArrowRight": "right",
    "ArrowUp": "away",
    "ArrowDown": "near",
    "PageUp": "up",
    "PageDown": "down",
}
TURNS: dict[str, Literal[-1, 1]] = {"q": 1, "e": -1}
KEYS = 9  # objects that a number picks
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


class GripperControls:
    """The controls, built into the container that is open; `refresh` shows the demonstration in the making, `clear` removes
    its translucent copy from the scene."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.teaching = studio, page, studio.teaching
        self._guard = functools.partial(page.guard, steers="gripper")
        ui.on("teach_key", self._guard(self._key))
        self._posed: object = None
        self._done: object = None
        self._stepped = studio.teaching.step
        self._cells: dict[str, list[ui.label]] = {}
        self._pick_buttons: list[ui.button] = []
        self._move_buttons: list[ui.button] = []
        self._turn_buttons: list[ui.button] = []
        self._build()
        self._task_changed()
        page.on("task", self._task_changed, now=False)
        page.scene.on_pick(self._clicked)

    def clear(self) -> None:
        """Take the translucent copy out of the scene."""
        self.page.scene.ghost({}, group="landing")

    def refresh(self) -> None:
        """Show what was done and what can be done next."""
        teaching, session = self.teaching, self.teaching.session
        if session is None:
            return
        held, landing = session.held, teaching.landing
        for pick in self._pick_buttons:
            pick.set_enabled(held is None)
        for move in self._move_buttons:
            move.set_enabled(held is not None)
        for turn in self._turn_buttons:
            turn.set_enabled(held is not None and session.task.thing(held).symmetry > 0)
        self.destinations.refresh(held)
        self.release.set_enabled(held is not None)
        if teaching.step != self._stepped:  # else a step that is being written would be lost
            self._stepped = teaching.step
            self.step.set_value(in_millimetres(teaching.step))
        self._refresh_landing(session, landing)
        self._refresh_poses(session)
        if (done := teaching.done) != self._done:
            self._done = done
            self._show_done(done)

    def _show_done(self, done: list[str]) -> None:
        self.done.clear()
        with self.done:
            for sentence in done:
                with ui.element("li"):
                    ui.label(sentence)
            if not done:
                ui.label("nothing yet").classes("teach-hint")

    def _build(self) -> None:
        guard, teaching = self._guard, self.teaching
        with ui.row().classes("items-center gap-2 w-full"):
            heading("Demonstration in the making").classes("flex-1")
            button("Undo", "demonstrate-undo", "undo", guard(self._undo), more="flat title='Undo (Ctrl+Z)'")
            button("Discard", "demonstrate-discard", "close", guard(self._discard), more="flat")
            button("Finish", "demonstrate-finish", "check", guard(self._finish), more="color=positive")
        with ui.row().classes("items-center gap-2"):
            ui.label("Pick").classes("teach-word")
            self.picks = ui.row().classes("gap-2 items-center")
        with ui.row().classes("items-center gap-4 w-full no-wrap"):
            ui.label("Place").classes("teach-word")
            with ui.element("div").classes("teach-pad") as self.pad:
                for direction, icon, text, place in PAD:
                    move = button("", f"demonstrate-{direction}", icon, guard(self._mover(direction)), more="outline")
                    move.props(f'aria-label="{text}" title="{text}"').style(f"grid-area: {place}")
                    self._move_buttons.append(move)
                for key, icon, text, place in TURN_PAD:
                    turn = button(
                        "",
                        f"demonstrate-turn-{key}",
                        icon,
                        guard(functools.partial(teaching.turn, TURNS[key])),
                        more="outline",
                    )
                    turn.props(f'aria-label="{text}" title="{text}"').style(f"grid-area: {place}")
                    self._turn_buttons.append(turn)
            with ui.column().classes("gap-1"):
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
                self.release = button("Release", "demonstrate-release", "pan_tool_alt", guard(self._release))
                self.release.props("title='Let go (R)'").classes("w-full")
        self.destinations = Destinations(self.studio, self.page)
        self.landing = ui.label().classes("teach-landing").props("data-testid=demonstrate-landing role=status")
        with ui.element("div").classes("teach-columns"):
            with ui.element("div"):
                self.held_title = heading("")
                self.poses = ui.element("div").classes("teach-poses").props("data-testid=demonstrate-poses")
            with ui.element("div"):
                heading("Done so far")
                self.done = ui.element("ol").classes("teach-done").props("data-testid=demonstrate-done")
        ui.label(
            "Keys: the numbers pick; arrows and page up/down carry; Q and E turn; + and - change the step; R releases; "
            "Ctrl+Z undoes. Or click what you want to pick in the scene."
        ).classes("teach-hint")

    def _mover(self, direction: Direction) -> Callable[[], Awaitable[None]]:
        return lambda: self.teaching.move(direction)

    async def _key(self, event: GenericEventArguments) -> None:
        key, teaching = event.args, self.teaching
        if key in MOVES:
            await teaching.move(MOVES[key])
        elif key in TURNS:
            await teaching.turn(TURNS[key])
        elif key == "undo":
            await self._undo()
        elif key == "r":
            await self._release()
        elif key in "+=-":
            teaching.change_step(-1 if key == "-" else 1)
        elif key.isdecimal() and 1 <= int(key) <= len(self.studio.edited.task.objects):
            await self._pick(self.studio.edited.task.object_names[int(key) - 1])

    async def _clicked(self, name: str) -> None:
        if self.page.step == "demonstrate" and self.teaching.session is not None:
            self.page.steer("gripper")
            await self._pick(name)

    async def _pick(self, name: str) -> None:
        await self.teaching.pick(name)
        self.page.say(
            f"{name} is in the gripper: carry it with the arrow keys and page up and down, then let go with R."
        )

    async def _release(self) -> None:
        await self.teaching.release()
        self.page.say("The object is released. Pick another one, or finish.")

    async def _undo(self) -> None:
        await self.teaching.undo()
        session = self.teaching.session
        held = None if session is None else session.held
        self.page.say("Taken back." if held is None else f"Taken back; {held} is in the gripper.")

    async def _finish(self) -> None:
        name = await self.teaching.finish()
        self.page.let_go()
        self.page.say(f"{name} is kept. {self.studio.library.progress}", "success")

    async def _discard(self) -> None:
        session = self.teaching.session
        if session is not None and session.actions:
            question = "Discard this demonstration? Its actions will be lost."
            if not await ask(question, yes="Discard", testid="demonstrate-discard"):
                return
            if self.teaching.session is not session:
                raise UserError("that demonstration has ended already; nothing was discarded")
        await self.teaching.discard()
        self.page.let_go()
        self.page.say("The demonstration was discarded; the others are kept.")

    def _set_step(self) -> None:
        value = self.step.value
        try:
            self.teaching.set_step(None if value is None else in_metres(value))
        except UserError:
            self.step.set_value(in_millimetres(self.teaching.step))
            raise

    def _task_changed(self) -> None:
        self.picks.clear()
        self._pick_buttons = []
        with self.picks:
            for number, thing in enumerate(self.studio.edited.task.objects, start=1):
                has_key = number <= KEYS
                pick = button(
                    f"{number} {thing.name}" if has_key else thing.name,
                    f"demonstrate-pick-{thing.name}",
                    "stop" if thing.shape == "cuboid" else "circle",
                    self._guard(functools.partial(self._pick, thing.name)),
                    more=f"outline title='Key {number}'" if has_key else "outline",
                )
                pick.style(f"--box: {css_color(thing)}").classes("teach-pick")
                self._pick_buttons.append(pick)
        self.destinations.task_changed()
        numbers = " ".join(str(number) for number in range(1, min(KEYS, len(self.studio.edited.task.objects)) + 1))
        self.pad.props(f'data-teach-keys="{" ".join([*MOVES, *TURNS])} {numbers} + = - r"')
        self._posed = None
        self.refresh()

    def _refresh_landing(self, session: Teleoperation, landing: Landing | None) -> None:
        held = session.held
        bad = landing is not None and (landing.inside is not None or landing.on is None)
        self.landing.classes(add="teach-bad" if bad else "", remove="" if bad else "teach-bad")
        if landing is None or held is None:
            self.landing.set_text("The gripper is empty: pick an object, or finish.")
            self.clear()
            return
        pose = np.array(session.world.poses[0, session.task.object_names.index(held)])
        self.landing.set_text(_landing_sentence(session, held, landing))
        if bad:
            self.clear()
            return
        pose[:3] = landing.position
        self.page.scene.ghost({held: Ghost(held, pose, "lands here")}, group="landing")

    def _refresh_poses(self, session: Teleoperation) -> None:
        """Show where the held object is, in every frame."""
        held = session.held
        if (session, held) != self._posed:
            self._posed = (session, held)
            self.poses.clear()
            self.held_title.set_text("" if held is None else f"Where {held} is, in mm")
            self._cells = {}
            with self.poses:
                for title in () if held is None else ("seen from", "x", "y", "z", "turned"):
                    ui.label(title).classes("teach-hint")
                for frame in () if held is None else [name for name in session.task.frames if name != held]:
                    ui.label(self._called(frame)).props(f'title="{frame}"')
                    self._cells[frame] = [
                        ui.label().props(f"data-testid=demonstrate-pose-{frame}-{key}")
                        for key in ("x", "y", "z", "turn")
                    ]
        for frame, cells in self._cells.items():
            values = [_number(in_millimetres(value)) for value in session.position(frame)]
            for cell, text in zip(cells, (*values, f"{_number(session.turn(frame))}°"), strict=True):
                cell.set_text(text)

    def _called(self, frame: str) -> str:
        return known(frame, self.studio.edited.task, robot="the robot")


def _number(value: float) -> str:
    """Format with at most one digit after the point, and no minus before zero."""
    return f"{round(float(value), 1) + 0.0:g}".replace("-", "\N{MINUS SIGN}")


def _landing_sentence(session: Teleoperation, held: str, landing: Landing) -> str:
    """Say what happens if the held object is let go now."""
    if landing.inside is not None:
        return f"{held} is inside {landing.inside}: raise it, or carry it aside."
    if landing.on is None:
        return f"Below {held} is only the floor, where the gripper does not reach: carry it over a table."
    drop = float(session.world.poses[0, session.task.object_names.index(held), 2] - landing.position[2])
    where = f"set down on {landing.on}"
    for kit in session.task.kits:
        x, y, z = session.position(kit.name).tolist()
        slot = slot_at(kit, session.task.thing(held), (x, y, z - drop)) if kit.name == landing.on else None
        where = where if slot is None else f"set down in slot {slot.name} of {kit.name}"
    below = f", {length(drop)} below" if drop >= 0.001 else ""
    return f"If you let go now, {held} is {where}{below}."
