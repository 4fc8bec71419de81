"""Step 7: run the tree on the robot's twin, get in its way, look back at what happened, and prepare for the real robot."""

from __future__ import annotations

import functools
import shlex

from nicegui import ui
from nicegui.events import GenericEventArguments

from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button, mark, may_leave
from bt_jax.app.phrases import without_paths
from bt_jax.app.plain_words import Words
from bt_jax.app.processes.twin_messages import Item, Person
from bt_jax.app.state.robot_words import age_words, doing, moment_words, outcome_words, waiting_for
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.encoding.drawing.svg import node_ids

__all__ = ["build"]

REAL = (
    "The real robot is run from the command line only. A browser may freeze, lose its connection or be open twice, and a "
    "button in it is no emergency stop: that belongs in the hand of somebody who sees the robot. Nothing of this was ever "
    "tried on a real robot."
)
ICONS = {True: "check_circle", False: "cancel", None: "radio_button_unchecked"}
MEANINGS = {True: "in order", False: "to be done", None: "waits for another"}


def build(studio: Studio, page: PanelContext) -> None:
    """Build the controls of the run, the objects that a person can push, the tree, and what follows a run."""
    _Robot(studio, page)


class _Robot:
    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.robot = studio, page, studio.robot
        self._things: tuple[str, ...] = ()
        self._states: dict[str, ui.label] = {}
        self._buttons: dict[tuple[str, str], ui.button] = {}
        with ui.element("div").classes("robot"):
            with ui.row().classes("items-center gap-2") as self.refused:
                self.refusal = ui.label().classes("robot-refusal").props("data-testid=robot-refusal role=status")
                self.other = button("", "robot-other-task", "open_in_new", page.guard(self._open_other, steers="task"))
            with ui.row().classes("items-center gap-2") as self.controls:
                self.start = button("Start", "robot-start", "play_arrow", page.guard(self.robot.start))
                self.elsewhere = button(
                    "Start from other places",
                    "robot-elsewhere",
                    "shuffle",
                    page.guard(functools.partial(self.robot.start, elsewhere=True)),
                    more="outline",
                )
            self.what = ui.label().classes("run-what").props("data-testid=robot-what aria-live=polite")
            self.waits = ui.label().classes("robot-waits").props("data-testid=robot-waits")
            self.said = ui.label().classes("hint").props("data-testid=robot-said role=status")
            self.things = ui.element("div").classes("robot-things")
            self.tree = TreeView(testid="robot-tree", legend=True)
            with ui.expansion("Look back at a run", icon="history").props("dense data-testid=robot-back") as self.back:
                _LookBack(studio, page)
            with ui.expansion("The real robot", icon="precision_manufacturing").props("dense data-testid=robot-real"):
                _Preflight(studio, page)
        for topic in ("robot", "tree", "task"):
            page.on(topic, self._refresh)

    async def _open_other(self) -> None:
        name = self.robot.alternative
        if not name or not await may_leave(self.studio):
            return
        self.page.steer("task")  # again: a person may take their time to answer
        self.studio.open_task(self.studio.workspace.task(name))
        self.page.go("evolve")
        self.page.say(f"{name} is open: find a tree for it, then come back to step 7.", "success")

    def _refresh(self) -> None:
        robot = self.robot
        refusal, other = robot.refusal, robot.alternative
        live = robot.running or (robot.ended is not None and robot.record is None)
        self.refused.set_visibility(bool(refusal) and not robot.running)
        self.refusal.set_text(refusal)
        self.other.set_visibility(bool(other))
        self.other.set_text(f"Open {other}")
        for one in (self.start, self.elsewhere):
            one.set_enabled(not robot.running and not refusal)
        self.what.set_text(self._said())
        tick = robot.tick
        self.waits.set_text(waiting_for(tick) if tick is not None and robot.stage == "running" else "")
        self.said.set_text(_sentence(robot.said.text) if live else "")
        self._show_things()
        self._show_tree()

    def _said(self) -> str:
        robot = self.robot
        if robot.failure:
            return _sentence(robot.failure)
        if robot.record is not None:
            return moment_words(Words(robot.record.program.task), robot.record, robot.at)
        if robot.stage == "starting":
            return "Getting ready: the cell, the camera and the arms."
        if robot.running and robot.tick is not None and robot.run is not None:
            return f"{robot.tick.time:.0f} s: {doing(Words(robot.run.task), robot.tick)}"
        if robot.ended is not None:
            return outcome_words(robot.ended)
        return "" if robot.refusal else "The robot's twin is a simulated YuMi with a camera: press Start."

    def _show_things(self) -> None:
        """Show each object with what is known of it, and what a person can do with it."""
        robot = self.robot
        names = () if robot.run is None or not robot.running else robot.run.task.object_names
        if names != self._things:
            self._things, self._states = names, {}
            self.things.clear()
            with self.things:
                if names:
                    ui.label(
                        "Get in its way: drag an object in the camera's picture to another place or off the tables, click "
                        "it to push it, or press a button:"
                    ).classes("hint")
                for name in names:
                    self._thing(name)
        for name, label in self._states.items():
            label.set_text(age_words(robot.tick, name) if robot.tick is not None else "")
            away = robot.tick is not None and name in robot.tick.away
            for what, shown in (("push", not away), ("remove", not away), ("return", away)):
                self._buttons[what, name].set_visibility(shown)

    def _thing(self, name: str) -> None:
        with ui.element("div").classes("robot-thing"):
            ui.label(name).classes("robot-name")
            self._states[name] = mark(ui.label().classes("robot-seen"), f"robot-seen-{name}")
            for what, text, icon in (
                ("push", "Push", "swipe_right"),
                ("remove", "Take away", "logout"),
                ("return", "Bring back", "login"),
            ):
                request = Person(what, name)  # type: ignore[arg-type]
                press = self.page.guard(functools.partial(self.robot.disturb, request))
                made = button(text, f"robot-{what}-{name}", icon, press, more="flat")
                made.props["aria-label"] = f"{text}: {name}"
                self._buttons[what, name] = made

    def _show_tree(self) -> None:
        robot, studio = self.robot, self.studio
        if robot.record is not None:
            program = robot.record.program
            self.tree.show(program.tree, program.task)
            self.tree.colour(dict(zip(node_ids(program.tree), robot.record.moments[robot.at].statuses, strict=True)))
        elif robot.run is not None and (robot.running or robot.ended is not None):
            self.tree.show(robot.run.tree, robot.run.task)
            self.tree.colour(robot.statuses)
        else:
            self.tree.show(studio.playing.tree, studio.edited.task)


class _LookBack:
    """The logs of runs, and a time line through one of them."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.robot = studio, page, studio.robot
        with ui.column().classes("w-full gap-1"):
            self.choice = (
                ui.select([], label="Run")
                .on("update:model-value", page.guard(self._open))
                .props("dense outlined options-dense data-testid=robot-log")
                .classes("w-full")
            )
            with ui.row().classes("items-center gap-2 w-full no-wrap") as self.time:
                self.line = (
                    ui.slider(min=0, max=1, value=0)
                    .on("update:model-value", page.guard(self._seek), throttle=0.1)
                    .props('data-testid=robot-timeline aria-label="Time line"')
                    .classes("run-timeline")
                )
                self.clock = ui.label().classes("robot-clock").props("data-testid=robot-clock")
            self.events = ui.label().classes("hint whitespace-pre-line").props("data-testid=robot-events")
        page.on("robot", self._refresh)

    async def _open(self) -> None:
        if self.choice.value:
            await self.robot.look_back(self.choice.value)

    def _seek(self, event: GenericEventArguments) -> None:
        self.robot.seek(int(event.args))

    def _refresh(self) -> None:
        robot, record = self.robot, self.robot.record
        if not robot.running:
            names = self.studio.workspace.log_names()
            if names != self.choice.options or self.choice.value != (robot.record_name or None):
                self.choice.set_options(names, value=robot.record_name if robot.record_name in names else None)
        self.choice.set_enabled(not robot.running)
        self.time.set_visibility(record is not None)
        self.events.set_visibility(record is not None)
        if record is None:
            return
        self.line.props(f"max={max(len(record.moments) - 1, 1)}")
        self.line.set_value(robot.at)
        moment = record.moments[robot.at]
        self.clock.set_text(f"{moment.time:.1f} s")
        self.events.set_text("\n".join(_sentence(event) for event in moment.events))


class _Preflight:
    """Why the real robot is not run from here, what is in order for it, and the commands."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page, self.robot = studio, page, studio.robot
        self._shown: tuple[Item, ...] = ()
        with ui.column().classes("w-full gap-2"):
            ui.label(REAL).props("data-testid=robot-why")
            self.look = button("Look at what is in order", "robot-check", "checklist", page.guard(self.robot.check))
            self.list = ui.element("ul").classes("robot-items").props("data-testid=robot-items")
            self.how = ui.label().classes("robot-commands").props("data-testid=robot-commands")
        for topic in ("robot", "tree", "task"):
            page.on(topic, self._refresh)

    def _refresh(self) -> None:
        robot = self.robot
        self.look.set_enabled(not robot.running and not robot.checking and not robot.refusal)
        self.look.props(f"loading={'true' if robot.checking else 'false'}")
        if tuple(robot.items) != self._shown:
            self._shown = tuple(robot.items)
            self.list.clear()
            with self.list:
                for item in self._shown:
                    _item(item, without_paths(item.detail, self.studio.workspace.root))
        self.how.set_text(self._commands() if robot.items else "")

    def _commands(self) -> str:
        studio, run = self.studio, self.studio.playing.run
        source = "TREE.txt" if run is None else str(studio.workspace.runs / run)
        words = ["python", "-m", "bt_jax.deploy", "check", source, "--robot", "192.168.125.1", "--camera", "0"]
        words += ["--calibration", "camera.yaml"]
        return shlex.join(words if self.robot.log is None else [*words, "--twin-log", str(self.robot.log)])


def _item(item: Item, detail: str) -> None:
    with ui.element("li").classes("robot-item"):
        ui.icon(ICONS[item.passed]).props(f'role=img aria-label="{MEANINGS[item.passed]}"').classes(
            {True: "robot-good", False: "robot-bad", None: "robot-open"}[item.passed]
        )
        with ui.element("div"):
            ui.label(item.name).classes("robot-name")
            ui.label(_sentence(detail))


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}{'' if not text or text.endswith(('.', '!')) else '.'}"
