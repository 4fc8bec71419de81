"""One window of the page: the seven steps as tabs, the scene on the left, the step's panel on the right."""

from __future__ import annotations

import functools
import inspect
import traceback
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Literal

from nicegui import background_tasks, ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels import PANELS
from bt_jax.app.state.studio import Studio, Topic
from bt_jax.app.widgets.scene_view import SceneView

__all__ = ["STEPS", "Page", "Step"]

Step = Literal["task", "evolve", "demonstrate", "understand", "combine", "run", "keep"]
STEPS: tuple[Step, ...] = ("task", "evolve", "demonstrate", "understand", "combine", "run", "keep")
STYLE = Path(__file__).parent / "static" / "page.css"
BLUE, GREEN, ORANGE, VERMILION = "#0072b2", "#009e73", "#e69f00", "#d55e00"  # Okabe and Ito


class Page:
    """What the panels of one window share: the step that is shown, messages, and callbacks that end with the window."""

    def __init__(self, studio: Studio, step: str = STEPS[0]) -> None:
        self.studio, self.client = studio, ui.context.client
        self.step: Step = step if step in STEPS else STEPS[0]
        self._on_step: list[Callable[[Step], None]] = []
        ui.colors(primary=BLUE, secondary="#56616d", positive=GREEN, negative=VERMILION, warning=ORANGE)
        ui.add_css(STYLE)
        with ui.element("div").classes("page"):
            with ui.element("header").classes("page-header"):
                ui.label("bt_jax").classes("page-name")
                self._tabs = ui.tabs(on_change=lambda event: self._show(event.value)).props(
                    "dense no-caps inline-label"
                )
                with self._tabs:
                    for number, name in enumerate(STEPS, start=1):
                        ui.tab(name, f"{number} {name.capitalize()}").props(f"data-testid=tab-{name}")
            with ui.element("main").classes("page-main"):
                self.scene_area = ui.element("section").classes("page-scene").props("aria-label=Scene")
                with self.scene_area:
                    self.scene = SceneView(studio, self)
                self._panels = {}
                with ui.element("section").classes("page-side"):
                    for name in STEPS:
                        self._panels[name] = ui.element("div").classes("page-panel").props(f"data-testid=panel-{name}")
            with ui.element("footer").classes("page-footer").props("role=status aria-live=polite"):
                self._message = ui.label().props("data-testid=message")
        for name, panel in self._panels.items():
            with panel:
                self._build(name)
        self.on("message", lambda: self._message.set_text(studio.message))
        self._tabs.set_value(self.step)
        self._show(self.step)

    def _build(self, step: Step) -> None:
        """One panel; where that fails, the others are there nevertheless."""
        try:
            PANELS[step](self.studio, self)
        except Exception as error:
            traceback.print_exc()
            ui.label(f"This step cannot be shown ({type(error).__name__}: {error}); the others can, see the terminal.")

    def on(self, topic: Topic, callback: Callable[[], Any], *, now: bool = True) -> None:
        """Calls back after each change of the studio, in this window, as long as it is open; and `now`, at once. The
        function may be a coroutine."""
        self.client.on_delete(self.studio.subscribe(topic, lambda: self._call(callback)))
        if now:
            self._call(callback)

    def on_step(self, callback: Callable[[Step], Any]) -> None:
        """Calls back with the name of the step whenever this window shows another; the function may be a coroutine."""
        self._on_step.append(callback)

    def go(self, step: Step) -> None:
        """Shows another step in this window."""
        self._tabs.set_value(step)

    def _show(self, step: Step) -> None:
        if step != self.step:
            ui.navigate.history.replace(f"?step={step}")
        self.step = step
        for name, panel in self._panels.items():
            panel.set_visibility(name == step)
        for callback in self._on_step:
            self._call(callback, step)

    def _call(self, callback: Callable[..., Any], *args: Any) -> None:
        """Calls back in this window, or starts what is a coroutine."""
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

    def guard(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        """A handler whose errors become a sentence on the page."""

        @functools.wraps(handler)
        async def guarded(*args: Any, **kwargs: Any) -> None:
            try:
                result = handler(*args, **kwargs)
                if inspect.isawaitable(result):
                    await result
            except Exception as error:
                self._fail(error)

        return guarded

    def _fail(self, error: Exception) -> None:
        """Says that something went wrong which nobody has foreseen, or what a person can mend."""
        if isinstance(error, UserError):
            self.complain(str(error))
            return
        traceback.print_exception(error)
        self.complain(f"{type(error).__name__}: {error}; nothing was lost, see the terminal")

    def complain(self, sentence: str) -> None:
        """Says what went wrong, in the footer and as a notification in this window."""
        self.studio.say(sentence)
        with self.client:
            ui.notify(
                sentence,
                color="dark",
                icon="warning",
                position="bottom-left",  # over the scene, not over what one clicks next
                multi_line=True,
                actions=[{"label": "Close", "color": "white", "noCaps": True}],
                timeout=8000,
            )
