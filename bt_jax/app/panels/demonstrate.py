"""Step 3: demonstrate what evolution does not find; pick, carry under the keys, let go, and keep it."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

from nicegui import ui
from nicegui.events import GenericEventArguments

from bt_jax.app.panels.parts import ask, ask_for, button, heading, mark
from bt_jax.app.studio import Studio
from bt_jax.app.teaching import Direction
from bt_jax.errors import UserError
from bt_jax.teleoperation import Landing

if TYPE_CHECKING:
    from bt_jax.app.page import Page, Step

__all__ = ["build"]

SCRIPTS = [Path(__file__).parents[1] / name for name in ("keys.js", "focus.js")]
MOVES: dict[str, Direction] = {
    "ArrowLeft": "left",
    "ArrowRight": "right",
    "ArrowUp": "away",
    "ArrowDown": "near",
    "PageUp": "up",
    "PageDown": "down",
}
PAD: tuple[tuple[Direction, str, str, str], ...] = (  # direction, icon, what it does, place in the grid
    ("away", "arrow_upward", "Away from you (arrow up)", "1 / 2"),
    ("left", "arrow_back", "To the left (arrow left)", "2 / 1"),
    ("near", "arrow_downward", "Towards you (arrow down)", "2 / 2"),
    ("right", "arrow_forward", "To the right (arrow right)", "2 / 3"),
    ("up", "keyboard_double_arrow_up", "Higher (page up)", "1 / 5"),
    ("down", "keyboard_double_arrow_down", "Lower (page down)", "2 / 5"),
)
LAYOUTS = (
    "Boxes begin elsewhere in each demonstration. Only then can it be told whether a place is meant on the table, in the "
    "kit, or at another box."
)


def build(studio: Studio, page: Page) -> None:
    """The list of demonstrations, or the gripper while one is in the making."""
    _Demonstrate(studio, page)


class _Demonstrate:
    def __init__(self, studio: Studio, page: Page) -> None:
        self.studio, self.page, self.teaching = studio, page, studio.teaching
        for script in SCRIPTS:
            ui.add_head_html(f"<script>{script.read_text(encoding='utf-8')}</script>")
        ui.on("teach_key", page.guard(self._key))
        with ui.element("div").classes("teach"):
            self.idle = ui.element("div").classes("teach")
            with self.idle:
                self._build_idle()
            self.making = ui.element("div").classes("teach")
            with self.making:
                self._build_making()
        self._listed: object = None
        self._posed: object = None
        page.on("task", self._task_changed)
        page.on("demonstrations", self._refresh)
        page.on("tree", self._refresh)
        page.on_step(page.guard(self._enter))
        page.scene.on_pick(self._clicked)
        if not self.teaching.read:
            ui.timer(0, page.guard(self.teaching.refresh), once=True)

    def _build_idle(self) -> None:
        teaching, page = self.teaching, self.page
        with ui.row().classes("items-center gap-2 w-full no-wrap"):
            self.set = (
                ui.select([self.studio.demonstration_set], value=self.studio.demonstration_set, label="Set")
                .props("dense outlined data-testid=demonstrate-set")
                .classes("w-48")
            )
            self.set.on("update:model-value", page.guard(self._use_set))
            button("New set", "demonstrate-new-set", "create_new_folder", page.guard(self._new_set), more="flat")
        with ui.row().classes("items-center gap-3 no-wrap"):
            self.dots = ui.label().classes("teach-dots").props("aria-hidden=true")
            self.progress = ui.label().props("data-testid=demonstrate-progress")
        heading("New demonstration")
        with ui.row().classes("items-center gap-2"):
            button("From the start", "demonstrate-new", "add", page.guard(self._begin))
            self.reached = button(
                "From where the tree ends",
                "demonstrate-new-reached",
                "account_tree",
                page.guard(functools.partial(self._begin, reached=True)),
                more="outline",
            )
        self.elsewhere = ui.checkbox("Each in another layout", value=teaching.elsewhere).props(
            "dense data-testid=demonstrate-elsewhere"
        )
        self.elsewhere.on("update:model-value", self._choose_layout)
        ui.label(LAYOUTS).classes("teach-hint")
        heading("Demonstrations")
        self.list = ui.element("div").classes("teach-list").props("data-testid=demonstrate-list role=list")

    def _build_making(self) -> None:
        page, teaching = self.page, self.teaching
        with ui.row().classes("items-center gap-2 w-full"):
            heading("Demonstration in the making").classes("flex-1")
            button("Undo", "demonstrate-undo", "undo", page.guard(self._undo), more="flat title='Undo (Ctrl+Z)'")
            button("Discard", "demonstrate-discard", "close", page.guard(self._discard), more="flat")
            button("Finish", "demonstrate-finish", "check", page.guard(self._finish), more="color=positive")
        with ui.row().classes("items-center gap-2"):
            ui.label("Pick").classes("teach-word")
            self.picks = ui.row().classes("gap-2 items-center")
        with ui.row().classes("items-center gap-4 w-full no-wrap"):
            ui.label("Place").classes("teach-word")
            with ui.element("div").classes("teach-pad") as self.pad:
                for direction, icon, text, place in PAD:
                    move = button(
                        "", f"demonstrate-{direction}", icon, page.guard(self._mover(direction)), more="outline"
                    )
                    move.props(f'aria-label="{text}" title="{text}"').style(f"grid-area: {place}")
            with ui.column().classes("gap-1"):
                with ui.row().classes("items-center gap-1 no-wrap"):
                    smaller = "flat round aria-label='Smaller step (-)' title='Smaller step (-)'"
                    larger = "flat round aria-label='Larger step (+)' title='Larger step (+)'"
                    button(
                        "", "demonstrate-smaller", "remove", page.guard(lambda: teaching.change_step(-1)), more=smaller
                    )
                    self.step = (
                        ui.number("Step", value=100 * teaching.step, min=0.1, max=50, format="%g", suffix="cm")
                        .props("dense outlined data-testid=demonstrate-step")
                        .classes("teach-step")
                    )
                    self.step.on("change", page.guard(self._set_step))
                    button("", "demonstrate-larger", "add", page.guard(lambda: teaching.change_step(1)), more=larger)
                self.release = button("Release", "demonstrate-release", "pan_tool_alt", page.guard(self._release))
                self.release.props("title='Let go (R)'").classes("w-full")
        with ui.row().classes("items-center gap-2"):
            ui.label("Over").classes("teach-word")
            self.over = ui.row().classes("gap-2 items-center")
        self.landing = ui.label().classes("teach-landing").props("data-testid=demonstrate-landing role=status")
        with ui.element("div").classes("teach-columns"):
            with ui.element("div"):
                self.held_title = heading("")
                self.poses = ui.element("div").classes("teach-poses").props("data-testid=demonstrate-poses")
            with ui.element("div"):
                heading("Done so far")
                self.done = ui.element("ol").classes("teach-done").props("data-testid=demonstrate-done")
        ui.label(
            "Keys: 1, 2, 3 pick; arrows and page up/down carry; + and - change the step; R lets go; Ctrl+Z takes back. Or "
            "click a box in the scene to pick it."
        ).classes("teach-hint")

    def _mover(self, direction: Direction):
        return lambda: self.teaching.move(direction)

    async def _key(self, event: GenericEventArguments) -> None:
        key, teaching = event.args, self.teaching
        if key in MOVES:
            await teaching.move(MOVES[key])
        elif key == "undo":
            await self._undo()
        elif key == "r":
            await self._release()
        elif key in "+=-":
            teaching.change_step(-1 if key == "-" else 1)
        elif key.isdecimal() and 1 <= int(key) <= len(self.studio.task.boxes):
            await self._pick(self.studio.task.box_names[int(key) - 1])

    async def _clicked(self, name: str) -> None:
        if self.page.step == "demonstrate" and self.studio.session is not None:
            await self._pick(name)

    async def _begin(self, *, reached: bool = False) -> None:
        await self.teaching.begin(reached=reached)
        self.studio.say("Pick an object: click it, or press its number.")

    async def _pick(self, name: str) -> None:
        await self.teaching.pick(name)
        self.studio.say(
            f"{name} is in the gripper: carry it with the arrow keys and page up and down, then let go with R."
        )

    async def _release(self) -> None:
        await self.teaching.release()
        self.studio.say("It is let go. Pick another object, or finish.")

    async def _undo(self) -> None:
        await self.teaching.undo()
        held = self.studio.session.held
        self.studio.say("Taken back." if held is None else f"Taken back; {held} is in the gripper.")

    async def _finish(self) -> None:
        name = await self.teaching.finish()
        self.studio.say(f"{name} is kept. {self.teaching.progress}")

    async def _discard(self) -> None:
        session = self.studio.session
        if session is not None and session.actions:
            question = "Discard this demonstration? What was done in it is lost."
            if not await ask(question, yes="Discard", testid="demonstrate-discard"):
                return
        await self.teaching.discard()
        self.studio.say("The demonstration was discarded; the others are kept.")

    def _choose_layout(self) -> None:
        self.teaching.elsewhere = bool(self.elsewhere.value)
        self.studio.changed("demonstrations")

    async def _use_set(self) -> None:
        if self.set.value and self.set.value != self.studio.demonstration_set:
            await self.teaching.use_set(self.set.value)

    async def _new_set(self) -> None:
        name = await ask_for("Name of the new set", value="", yes="Create", testid="demonstrate-new-set")
        if name and name.strip():
            await self.teaching.use_set(name.strip())

    async def _rename(self, name: str) -> None:
        new = await ask_for(f"New name of {name}", value=name, yes="Rename", testid="demonstrate-rename")
        if new is not None and new.strip() != name:
            await self.teaching.rename(name, new)

    async def _delete(self, name: str) -> None:
        if await ask(f"Delete {name}? This cannot be taken back.", yes="Delete", testid="demonstrate-delete"):
            await self.teaching.delete(name)
            self.studio.say(f"{name} is deleted. {self.teaching.progress}")

    async def _replay(self, name: str) -> None:
        if self.teaching.replayed == name:
            self.teaching.stop_replay()
            self.studio.changed("demonstrations")
        else:
            await self.teaching.replay(name)

    def _set_step(self) -> None:
        value = self.step.value
        try:
            self.teaching.set_step(None if value is None else value / 100)
        except UserError:
            self.step.set_value(100 * self.teaching.step)
            raise

    async def _enter(self, step: Step) -> None:
        """Whatever other steps have shown in the meantime, here it is the demonstration; what is on the disk is read."""
        if step != "demonstrate":
            return
        if self.studio.session is not None:
            self.studio.show(self.studio.session.world)
        self._refresh()
        await self.teaching.refresh()

    def _task_changed(self) -> None:
        self.picks.clear()
        with self.picks:
            for number, box in enumerate(self.studio.task.boxes, start=1):
                red, green, blue = (round(255 * part) for part in box.color)
                pick = button(
                    f"{number} {box.name}",
                    f"demonstrate-pick-{box.name}",
                    "stop",
                    self.page.guard(functools.partial(self._pick, box.name)),
                    more=f"outline title='Key {number}'",
                )
                pick.style(f"--box: rgb({red} {green} {blue})").classes("teach-pick")
        self.over.clear()
        with self.over:
            for frame in (*self.studio.task.box_names, self.studio.task.kit.name):
                over = self.page.guard(functools.partial(self.teaching.carry_over, frame))
                text = f"outline title='Carry straight over {frame}'"
                button(self._known(frame), f"demonstrate-over-{frame}", "vertical_align_bottom", over, more=text)
        numbers = " ".join(str(number) for number in range(1, min(10, len(self.studio.task.boxes) + 1)))
        self.pad.props(f'data-teach-keys="{" ".join(MOVES)} {numbers} + = - r"')
        self._posed = None
        self._refresh()

    def _refresh(self) -> None:
        teaching, session = self.teaching, self.studio.session
        self.idle.set_visibility(session is None)
        self.making.set_visibility(session is not None)
        if session is None:
            self.page.scene.ghost({}, group="landing")
            self._refresh_idle()
            return
        held, landing = session.held, teaching.landing
        for pick in self.picks.default_slot.children:
            pick.set_enabled(held is None)
        for move in self.pad.default_slot.children:
            move.set_enabled(held is not None)
        for over, frame in zip(self.over.default_slot.children, (*session.task.box_names, ""), strict=True):
            over.set_enabled(held is not None)
            over.set_visibility(held is None or held != frame)
        self.release.set_enabled(held is not None)
        self.step.set_value(round(100 * teaching.step, 3))
        self._refresh_landing(landing)
        self._refresh_poses()
        done = teaching.done
        self.done.clear()
        with self.done:
            for sentence in done:
                with ui.element("li"):
                    ui.label(sentence)
        if not done:
            with self.done:
                ui.label("nothing yet").classes("teach-hint")

    def _refresh_landing(self, landing: Landing | None) -> None:
        session = self.studio.session
        bad = landing is not None and (landing.inside is not None or landing.on is None)
        self.landing.classes(add="teach-bad" if bad else "", remove="" if bad else "teach-bad")
        if landing is None:
            self.landing.set_text("The gripper is empty: pick an object, or finish.")
            self.page.scene.ghost({}, group="landing")
            return
        pose = session.world.poses[0, session.task.box_names.index(session.held)].copy()
        self.landing.set_text(_landing_sentence(session.held, landing, drop=float(pose[2] - landing.position[2])))
        if bad:
            self.page.scene.ghost({}, group="landing")
            return
        pose[:3] = landing.position
        self.page.scene.ghost({session.held: pose}, group="landing", texts={session.held: "lands here"})

    def _refresh_poses(self) -> None:
        """Where the held object is, in every frame."""
        session = self.studio.session
        held = session.held
        if (session, held) != self._posed:
            self._posed = (session, held)
            self.poses.clear()
            self.held_title.set_text("" if held is None else f"Where {held} is, in cm")
            self._cells = {}
            with self.poses:
                for title in () if held is None else ("seen from", "x", "y", "z", "turned"):
                    ui.label(title).classes("teach-hint")
                for frame in () if held is None else [name for name in session.task.frames if name != held]:
                    ui.label(self._known(frame)).props(f'title="{frame}"')
                    self._cells[frame] = [
                        ui.label().props(f"data-testid=demonstrate-pose-{frame}-{key}")
                        for key in ("x", "y", "z", "turn")
                    ]
        for frame, cells in self._cells.items():
            values = [_number(100 * value) for value in session.position(frame)]
            for cell, text in zip(cells, (*values, f"{_number(session.turn(frame))}°"), strict=True):
                cell.set_text(text)

    def _known(self, frame: str) -> str:
        """What a person calls a frame."""
        task = self.studio.task
        return {task.kit.name: "the kit", task.robot_frame: "the robot"}.get(frame, frame)

    def _refresh_idle(self) -> None:
        studio, teaching = self.studio, self.teaching
        names = sorted({*studio.workspace.demonstration_sets(), studio.demonstration_set})
        if (self.set.options, self.set.value) != (names, studio.demonstration_set):
            self.set.set_options(names, value=studio.demonstration_set)
        good = sum(not one.problem for one in teaching.kept)
        self.dots.set_text("\N{BLACK CIRCLE}" * min(good, 3) + "\N{WHITE CIRCLE}" * max(0, 3 - good))
        self.progress.set_text(teaching.progress)
        self.elsewhere.set_value(teaching.elsewhere)
        self.reached.set_enabled(studio.tree is not None)
        self.reached.props("title=''" if studio.tree else "title='Evolve a tree first (step 2)'")
        shown = (teaching.kept, teaching.replayed)
        if shown == self._listed:
            return
        self._listed = shown
        self.list.clear()
        with self.list:
            for one in teaching.kept:
                self._row(one.name, one.summary, one.problem)
            if not teaching.kept:
                ui.label("none yet").classes("teach-hint")

    def _row(self, name: str, summary: str, problem: str) -> None:
        guard, playing = self.page.guard, self.teaching.replayed == name
        row = ui.element("div").classes("teach-row").props("role=listitem")
        with mark(row, f"demonstrate-row-{name}"):
            with ui.element("div").classes("teach-what"):
                ui.label(name).classes("text-bold")
                ui.label(problem or f"moves {summary}").classes("teach-bad" if problem else "teach-hint")
            for key, icon, text, handler in (
                ("replay", "stop" if playing else "play_arrow", "Stop" if playing else "Replay", self._replay),
                ("rename", "edit", "Rename", self._rename),
                ("delete", "delete", "Delete", self._delete),
            ):
                action = button("", "", icon, guard(functools.partial(handler, name)), more="flat")
                mark(action, f"demonstrate-{key}-{name}", aria_label=f"{text} {name}", title=text)
                action.set_enabled(key != "replay" or not problem)


def _number(value: float) -> str:
    """With one digit after the point, and no minus before zero."""
    return f"{round(float(value), 1) + 0.0:.1f}".replace("-", "\N{MINUS SIGN}")


def _landing_sentence(held: str, landing: Landing, *, drop: float) -> str:
    """What would happen if the object were let go now, `drop` [m] above where it would be set down."""
    if landing.inside is not None:
        return f"{held} is inside {landing.inside}: raise it, or carry it aside."
    if landing.on is None:
        return f"Below {held} is only the floor, where the gripper does not reach: carry it over a table."
    below = f", {100 * drop:.1f} cm below" if drop >= 0.001 else ""
    return f"If you let go now, {held} is set down on {landing.on}{below}."
