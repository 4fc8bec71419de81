"""The tour: two minutes through the steps, on the first visit of a browser and whenever a person asks for it."""

from __future__ import annotations

import dataclasses
import json

from nicegui import ui

from bt_jax.app.state.steps import Step
from bt_jax.app.widgets.context import PageContext

__all__ = ["STOPS", "Stop", "Tour"]


@dataclasses.dataclass(frozen=True)
class Stop:
    """A sentence or two about what lies at a CSS selector, in a step."""

    step: Step
    lit: str
    title: str
    text: str


def _tab(step: Step) -> str:
    return f"[data-testid=tab-{step}]"


STOPS = (
    Stop(
        "task",
        ".page-scene",
        "Your work place",
        "Here you teach a robot to fill a kit. This is the scene: drag where it is empty to turn it, turn the wheel to come "
        "closer. The buttons in its corner show it from the front, from the side and from above.",
    ),
    Stop(
        "task",
        _tab("task"),
        "Say what is wanted",
        "Choose a task, and drag what is dashed to where things should be. Or write it in millimetres. "
        "You can undo every change.",
    ),
    Stop(
        "evolve",
        _tab("evolve"),
        "Let it find a way",
        "Press “Find a tree”: the program plans what the robot does. Where no plan works, it tries out what the robot could "
        "do, again and again, and keeps what works best.",
    ),
    Stop(
        "demonstrate",
        _tab("demonstrate"),
        "Show what it does not find",
        "Pick something up, carry it, let go. Show the same three times: things begin elsewhere each time, "
        "so that it sees what matters.",
    ),
    Stop(
        "understand",
        _tab("understand"),
        "Check what it has understood",
        "It says in words what you have shown, and what each place belongs to: the table, the kit or another thing. "
        "Correct it with one click.",
    ),
    Stop(
        "combine",
        _tab("combine"),
        "Put both together",
        "What you have shown becomes part of what the program finds, and it goes on from there.",
    ),
    Stop(
        "run",
        _tab("run"),
        "Watch it",
        "See the robot do the task, step by step and in words. Move something while it runs: it should notice, and react.",
    ),
    Stop(
        "robot",
        _tab("robot"),
        "Try it on the robot's twin",
        "A simulated robot with a camera does the task. Push things, take them away, and stop it at any time.",
    ),
    Stop(
        "keep",
        _tab("keep"),
        "Keep what works",
        "All that was found is kept here. Compare, download, or make a film of it.",
    ),
    Stop(
        "task",
        ".next-bar",
        "What next?",
        "This bar says what comes next, in every step. A tick on a tab says that the step is done. "
        "You can go to any step at any time. The tour is at the top right, whenever you want it again.",
    ),
)


class Tour:
    """A card that leads from stop to stop, built into the container that is open. The page can be used meanwhile."""

    def __init__(self, page: PageContext) -> None:
        self._page, self._at, self._from = page, 0, page.step
        with ui.element("section").classes("tour").props("data-testid=tour-card role=dialog aria-label=Tour") as card:
            self._card = card
            self._count = ui.label().classes("hint").props("data-testid=tour-count")
            self._title = ui.label().classes("part-heading").props("role=heading aria-level=2")
            self._text = ui.label().props("data-testid=tour-text aria-live=polite")
            with ui.row().classes("items-center gap-2 w-full"):
                ui.button("Skip the tour", on_click=self._end).props("flat no-caps dense data-testid=tour-skip")
                ui.space()
                self._back = ui.button("Back", on_click=lambda: self._show(self._at - 1))
                self._back.props("flat no-caps dense data-testid=tour-back")
                self._next = ui.button("Next", on_click=self._go_on)
                self._next.props("no-caps unelevated dense data-testid=tour-next").classes("part-button")
        card.on("keydown.esc", self._end)
        card.set_visibility(False)
        ui.on("tour_first_visit", self.begin)

    def begin(self) -> None:
        """Begin with the first stop."""
        self._from = self._page.step
        self._card.set_visibility(True)
        self._show(0)
        ui.run_javascript("document.querySelector('[data-testid=tour-next]').focus()")

    def _go_on(self) -> None:
        if self._at + 1 < len(STOPS):
            self._show(self._at + 1)
        else:
            self._end()

    def _show(self, at: int) -> None:
        stop, self._at = STOPS[at], at
        self._page.go(stop.step)
        self._count.set_text(f"{at + 1} of {len(STOPS)}")
        self._title.set_text(stop.title)
        self._text.set_text(stop.text)
        self._back.set_enabled(at > 0)
        self._next.set_text("Next" if at + 1 < len(STOPS) else "Done")
        ui.run_javascript(f"tour.show({json.dumps(stop.lit)})")

    def _end(self) -> None:
        """Go back to where the tour began, which the browser remembers to have seen."""
        self._card.set_visibility(False)
        self._page.go(self._from)
        ui.run_javascript("tour.show(''); tour.seen(); document.querySelector('[data-testid=tour]').focus()")
