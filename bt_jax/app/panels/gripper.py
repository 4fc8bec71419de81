"""The gripper in step 3: what a person does with it by mouse, finger, keys and buttons, and what was done so far."""

from __future__ import annotations

import functools

import numpy as np
from nicegui import ui
from nicegui.events import GenericEventArguments

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.destinations import Destinations
from bt_jax.app.panels.gripper_pad import MOVES, TURNS, GripperPad
from bt_jax.app.panels.gripper_place import HeldPlace, LandingLine
from bt_jax.app.panels.parts import button, css_color, heading
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.dialogs import ask

__all__ = ["GripperControls"]

KEYS = 9  # objects that a number picks
MOUSE = "Drag an object in the scene to where it belongs; the wheel, or a tap of a second finger, turns it on the way."
KEYBOARD = (
    "Or click an object to pick it, another one to carry it over that, and itself to let it go. Keys: the numbers pick; "
    "arrows and page up/down carry, as you see it; Q and E turn; + and - change the step; R releases; Ctrl+Z undoes."
)
AGAIN = "Take the next object, or finish."


class GripperControls:
    """The controls, built into the container that is open; `refresh` shows the demonstration in the making, `clear` removes
    its translucent copy from the scene."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.teaching = studio, page, studio.teaching
        self._guard = functools.partial(page.guard, steers="gripper")
        self._done: object = None
        self._pick_buttons: list[ui.button] = []
        self._build()
        self._task_changed()
        ui.on("teach_key", self._guard(self._key))
        page.on("task", self._task_changed, now=False)
        page.scene.on_pick(self._clicked)
        page.scene.on_carry(self._dropped)

    def clear(self) -> None:
        """Take the translucent copy out of the scene."""
        self.landing.clear()

    def focus(self) -> None:
        """Give the keyboard to the gripper or, without a demonstration in the making, to what begins one."""
        wanted = "[data-testid=demonstrate-new]" if self.teaching.session is None else "[data-teach-keys]"
        ui.run_javascript(f"focusSoon('{wanted}')")

    def refresh(self) -> None:
        """Show what was done and what can be done next."""
        session = self.teaching.session
        if session is None:
            return
        held = session.held
        for pick in self._pick_buttons:
            pick.set_enabled(held is None)
        self.pad.refresh(holds=held is not None, turns=held is not None and session.task.thing(held).symmetry > 0)
        self.destinations.refresh(held)
        self.landing.refresh(session, self.teaching.landing)
        self.place.refresh(session)
        if (done := self.teaching.done) != self._done:
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
        guard = self._guard
        with ui.element("div").classes("teach") as self.area:
            with ui.row().classes("items-center gap-2 w-full"):
                heading("Demonstration in the making").classes("flex-1")
                button("Undo", "demonstrate-undo", "undo", guard(self._undo), more="flat title='Undo (Ctrl+Z)'")
                button("Discard", "demonstrate-discard", "close", guard(self._discard), more="flat")
                button("Finish", "demonstrate-finish", "check", guard(self._finish), more="color=positive")
            ui.label(MOUSE).classes("teach-hint")
            with ui.row().classes("items-center gap-2"):
                ui.label("Pick").classes("teach-word")
                self.picks = ui.row().classes("gap-2 items-center")
            with ui.row().classes("items-center gap-4 w-full no-wrap"):
                ui.label("Place").classes("teach-word")
                self.pad = GripperPad(self.studio, self.page)
                with ui.column().classes("gap-1"):
                    self.pad.build_step()
                    release = button("Release", "demonstrate-release", "pan_tool_alt", guard(self._release))
                    release.props("title='Let go (R)'").classes("w-full")
            self.destinations = Destinations(self.studio, self.page)
            self.landing = LandingLine(self.page)
            with ui.element("div").classes("teach-columns"):
                with ui.element("div"):
                    self.place = HeldPlace()
                with ui.element("div"):
                    heading("Done so far")
                    self.done = ui.element("ol").classes("teach-done").props("data-testid=demonstrate-done")
            ui.label(KEYBOARD).classes("teach-hint")
        self.area.props('tabindex=-1 role=group aria-label="Demonstration in the making"')

    async def _key(self, event: GenericEventArguments) -> None:
        key, again = event.args["key"], event.args["repeat"]
        session, teaching = self.teaching.session, self.teaching
        if again and (session is None or session.held is None or teaching.at_work):
            return  # a key that is held longer than there is something to carry
        if key in MOVES:
            await self.pad.move(MOVES[key])
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
        """Pick what was clicked, or carry what is held over it; the held object itself is let go."""
        session = self.teaching.session
        if self.page.step != "demonstrate" or session is None:
            return
        self.page.steer("gripper")
        if session.held is None:
            await self._pick(name)
        elif session.held == name:
            await self._release()
        else:
            await self.teaching.carry_over(name)
            self.page.say(f"{session.held} is over {name}: click {session.held} or press R to let it go.")

    async def _dropped(self, name: str, position: np.ndarray, turn: float) -> None:
        if self.page.step != "demonstrate" or self.teaching.session is None:
            return
        self.page.steer("gripper")
        slot = await self.teaching.drag(name, position, turn)
        self.page.say(f"{name} is in {slot}. {AGAIN}" if slot else f"{self.teaching.done[-1]}. {AGAIN}")

    async def _pick(self, name: str) -> None:
        await self.teaching.pick(name)
        self.page.say(f"{name} is in the gripper: carry it with the mouse or the arrow keys, then let go with R.")

    async def _release(self) -> None:
        session = self.teaching.session
        held = None if session is None else session.held
        await self.teaching.release()
        self.page.say(f"The gripper is empty. {AGAIN}" if held is None else f"{held} is released. {AGAIN}")

    async def _undo(self) -> None:
        await self.teaching.undo()
        session = self.teaching.session
        held = None if session is None else session.held
        self.page.say("Taken back." if held is None else f"Taken back; {held} is in the gripper.")

    async def _finish(self) -> None:
        name = await self.teaching.finish()
        self.page.let_go()
        self.focus()
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
        self.focus()
        self.page.say("The demonstration was discarded; the others are kept.")

    def _task_changed(self) -> None:
        task = self.studio.edited.task
        self.picks.clear()
        self._pick_buttons = []
        with self.picks:
            for number, thing in enumerate(task.objects, start=1):
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
        numbers = " ".join(str(number) for number in range(1, min(KEYS, len(task.objects)) + 1))
        self.area.props(f'data-teach-keys="{" ".join([*MOVES, *TURNS])} {numbers} + = - r"')
        self.refresh()
