"""The bar at the foot of every step: what comes next, and the button that leads there."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.state.steps import TITLES, advice
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext

__all__ = ["NextBar"]


class NextBar:
    """Built into the container that is open. The button is filled once the step needs nothing more."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self._studio, self._page = studio, page
        with ui.element("div").classes("next-bar"):
            self._sentence = ui.label().classes("next-sentence").props("data-testid=next-sentence")
            self._button = ui.button("", on_click=page.guard(self._go)).props(
                "no-caps unelevated dense icon-right=arrow_forward data-testid=next"
            )
            self._button.classes("part-button")
        for topic in ("task", "runs", "tree", "evolution", "demonstrations", "lesson", "player"):
            page.on(topic, self._refresh)
        page.on_step(lambda step: self._refresh())

    def _refresh(self) -> None:
        found = advice(self._studio, self._page.step)
        self._sentence.set_text(found.sentence)
        self._button.set_text(f"Next: {TITLES[found.step]}")
        self._button.props(add="" if found.ready else "outline", remove="outline" if found.ready else "")

    def _go(self) -> None:
        self._page.go(advice(self._studio, self._page.step).step)
