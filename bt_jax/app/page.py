"""One window of the page: the eight steps as tabs, the scene on the left, the step's panel on the right."""

from __future__ import annotations

import functools
import inspect
import traceback
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from nicegui import background_tasks, ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels import PANELS
from bt_jax.app.panels.goal_banner import GoalBanner
from bt_jax.app.phrases import phrase
from bt_jax.app.state.bus import Kind, Message, Topic
from bt_jax.app.state.holds import Shared, Window
from bt_jax.app.state.refreshing import Refreshing
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import STEPS, Step
from bt_jax.app.widgets.message_line import MessageLine
from bt_jax.app.widgets.next_bar import NextBar
from bt_jax.app.widgets.notice_strip import NoticeStrip
from bt_jax.app.widgets.page_header import PageHeader
from bt_jax.app.widgets.robot_bar import RobotBar
from bt_jax.app.widgets.robot_pictures import RobotPictures
from bt_jax.app.widgets.scene_text import SceneText
from bt_jax.app.widgets.scene_view import SceneView
from bt_jax.app.widgets.tour import Tour
from bt_jax.app.widgets.view_buttons import view_buttons

__all__ = ["Page"]

STATIC = Path(__file__).parent / "static"
STYLES = ("appearance.css", "page.css")
SCRIPTS = (
    "memory.js",
    "connection.js",
    "appearance.js",
    "shortcuts.js",
    "keys.js",
    "undo_keys.js",
    "focus.js",
    "history.js",
    "menus.js",
    "splitter.js",
    "tour.js",
)
BLUE, GREEN, ORANGE, VERMILION = "#0072b2", "#009e73", "#e69f00", "#d55e00"  # Okabe and Ito


class Page:
    """A window, as its panels and widgets see it (`widgets.context.PageContext`); its callbacks end with it."""

    def __init__(self, studio: Studio, step: str = STEPS[0]) -> None:
        self.studio, self.client = studio, ui.context.client
        self.window = Window(self.client.id, self.client.ip)
        self.client.on_disconnect(self.let_go)
        self.step: Step = next((name for name in STEPS if name == step), STEPS[0])
        self._on_step: list[Callable[[Step], None]] = []
        self._refreshing = Refreshing[Step](self._call, self.step)
        self._building: Step | None = None  # whose panel is being built
        self._built: set[Step] = set()
        ui.colors(primary=BLUE, secondary="#56616d", positive=GREEN, negative=VERMILION, warning=ORANGE)
        for style in STYLES:
            ui.add_css(STATIC / style)
        for script in SCRIPTS:
            ui.add_head_html(f"<script>{(STATIC / script).read_text(encoding='utf-8')}</script>")
        tour = Tour(self)
        with ui.element("div").classes("page"):
            self._header = PageHeader(studio, self, tour.begin)
            GoalBanner(studio, self)
            NoticeStrip(studio.notices, self)
            RobotBar(studio.robot, self)
            with ui.element("div").classes("page-main"):
                self.scene_area = ui.element("section").classes("page-scene").props("aria-label=Scene")
                with self.scene_area:
                    self.scene = SceneView(studio, self)
                    view_buttons(self.scene)
                    SceneText(studio, self, self.scene)
                    RobotPictures(studio.robot, self, self.scene)
                ui.element("div").classes("page-splitter").props(
                    'data-splitter role=separator tabindex=0 aria-label="Room for the scene" data-testid=splitter'
                )
                self._panels: dict[Step, ui.element] = {}
                with ui.element("section").classes("page-side"):
                    for name in STEPS:
                        self._panels[name] = ui.element("div").classes("page-panel").props(f"data-testid=panel-{name}")
                    following = ui.element("div").classes("page-next")
            with ui.element("div").classes("page-footer"):
                self._message = MessageLine()
        with following:
            NextBar(studio, self)
        self.on("news", lambda: self._message.hear(studio.bus.news), now=False)
        ui.on("step_in_history", lambda event: self._show(event.args if event.args in STEPS else STEPS[0]))
        self._show(self.step)
        if not studio.library.read:
            ui.timer(0, self.guard(studio.library.refresh), once=True)

    def _build(self, step: Step) -> None:
        """Build one panel, the first time that it is shown; if that fails, the others are still there."""
        if step in self._built:
            return
        self._built.add(step)
        self._building = step
        try:
            with self._panels[step]:
                PANELS[step](self.studio, self)
        except Exception as error:
            traceback.print_exc()
            with self._panels[step]:
                ui.label(
                    f"This step cannot be shown ({type(error).__name__}: {error}); see the terminal, and use the others."
                )
        finally:
            self._building = None

    def on(self, topic: Topic, callback: Callable[[], Any], *, now: bool = True) -> None:
        """Call back in this window after each change, as long as it is open, and at once if `now`; the function may be a
        coroutine. What a panel asks for while it is built waits until that panel is shown."""
        changed = self._refreshing.notice(self._building, callback)
        self.client.on_delete(self.studio.bus.subscribe(topic, changed))
        if now:
            self._call(callback)

    def on_step(self, callback: Callable[[Step], Any]) -> None:
        """Call back whenever this window shows another step; the function may be a coroutine."""
        self._on_step.append(callback)

    def go(self, step: Step) -> None:
        """Show another step in this window, to which its history leads back."""
        if step != self.step:
            ui.navigate.history.push(f"?step={step}")
            self._show(step)

    def _show(self, step: Step) -> None:
        if step != self.step:
            self._message.clear()
            self.let_go()
        self.step = step
        self._refreshing.show(step)
        self._build(step)
        self._header.show(step)
        for name, panel in self._panels.items():
            panel.set_visibility(name == step)
        for callback in self._on_step:
            self._call(callback, step)

    def _call(self, callback: Callable[..., Any], *args: Any) -> None:
        """Call back in this window; a coroutine is started as a task."""
        try:
            with self.client:
                result = callback(*args)
        except Exception as error:
            self._fail(error)
            return
        if inspect.isawaitable(result):
            background_tasks.create(self._inside(result))

    async def _inside(self, result: Awaitable[Any]) -> None:
        try:
            with self.client:
                await result
        except Exception as error:
            self._fail(error)

    def say(self, text: str, kind: Kind = "info") -> None:
        """Say one sentence in this window."""
        self._message.say(Message(text, kind))

    def steer(self, thing: Shared) -> None:
        """Steer something that all windows share. Raise UserError if another window does."""
        self.studio.holds.take(thing, self.window)

    def let_go(self) -> None:
        """Let other windows steer what this one has steered."""
        self.studio.holds.let_go(self.window)

    def guard(self, handler: Callable[..., Any], *, steers: Shared | None = None) -> Callable[..., Any]:
        """Return a handler of what a person does in this window: an error is said there as a sentence, and what was said
        before goes with the next success. It is called only if no other window steers the same thing."""

        @functools.wraps(handler)
        async def guarded(*args: Any, **kwargs: Any) -> None:
            said = self._message.count
            try:
                if steers is not None:
                    self.steer(steers)
                result = handler(*args, **kwargs)
                if inspect.isawaitable(result):
                    await result
            except Exception as error:
                self._fail(error)
                return
            if self._message.count == said:
                self._message.clear()

        return guarded

    def _fail(self, error: Exception) -> None:
        """Report an error: a UserError is a sentence for people, any other is a defect of the program."""
        sentence = phrase(error, self.studio.workspace.root)
        if not isinstance(error, UserError):
            traceback.print_exception(error)
            sentence = f"{type(error).__name__}: {sentence}; nothing was lost, see the terminal"
        self.say(sentence, "error")
