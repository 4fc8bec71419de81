"""The header of a window: the steps as tabs, with marks of what is done, and what concerns the whole page."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from bt_jax.app.state.steps import STEPS, TITLES, Step, done
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext

__all__ = ["PageHeader"]

APPEARANCES = (
    '<option value="system">As the system</option><option value="light">Light</option>'
    '<option value="dark">Dark</option><option value="contrast">High contrast</option>'
)
TICK = "\N{CHECK MARK}"


class PageHeader:
    """Built into the container that is open; `tour` begins the tour."""

    def __init__(self, studio: Studio, page: PageContext, tour: Callable[[], None]) -> None:
        self._studio = studio
        self._numbers: dict[Step, ui.label] = {}
        self._said: dict[Step, ui.label] = {}
        with ui.element("header").classes("page-header"):
            ui.label("bt_jax").classes("page-name")
            self._tabs = ui.tabs(on_change=lambda event: page.go(event.value)).props("dense no-caps")
            with self._tabs:
                for number, step in enumerate(STEPS, start=1):
                    self._tab(number, step)
            with ui.element("div").classes("page-tools"):
                ui.button("Tour", icon="help_outline", on_click=tour).props(
                    'flat dense no-caps data-testid=tour aria-label=Tour title="What the steps are for, in two minutes"'
                )
                ui.button(icon="keyboard").props(
                    'flat dense round data-shortcuts-button data-testid=shortcuts aria-label="Single keys as shortcuts"'
                )
                ui.html(APPEARANCES, tag="select", sanitize=False).classes("page-appearance").props(
                    'data-appearance data-testid=appearance aria-label="Colours" title="Colours"'
                )
        for topic in ("task", "runs", "tree", "evolution", "demonstrations", "lesson", "player"):
            page.on(topic, self._mark)

    def show(self, step: Step) -> None:
        """Mark the tab of a step as the one that is shown."""
        self._tabs.set_value(step)

    def _tab(self, number: int, step: Step) -> None:
        with ui.tab(step, "").props(f"data-testid=tab-{step}").classes("page-tab"), ui.row().classes("page-tab-row"):
            self._numbers[step] = ui.label(f"{number}").classes("page-tab-number")
            ui.label(TITLES[step])
            self._said[step] = ui.label("").classes("visually-hidden")
            if step == "task":
                self._unsaved = ui.badge().props("rounded color=warning data-testid=unsaved-mark")
                self._unsaved.props('role=img aria-label="not saved" title="not saved"').classes("unsaved-mark")

    def _mark(self) -> None:
        self._unsaved.set_visibility(self._studio.unsaved)
        found = done(self._studio)
        for number, step in enumerate(STEPS, start=1):
            is_done = step in found
            self._numbers[step].set_text(TICK if is_done else f"{number}")
            self._numbers[step].classes(add="done" if is_done else "", remove="" if is_done else "done")
            self._said[step].set_text(f", step {number}, done" if is_done else "")
