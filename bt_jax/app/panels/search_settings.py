"""How a tree is looked for: what may go wrong meanwhile, and under "Advanced" the settings of planning and evolution."""

from __future__ import annotations

import dataclasses

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.parts import MOST, mark, whole, whole_field
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.gp.config import GPConfig, Method
from bt_jax.tasks import load_faults, with_faults
from bt_jax.tasks.changes import without_faults
from bt_jax.tasks.faults import PRESETS

__all__ = ["Advanced", "Trouble"]

NONE, OWN = "none", "as the task says"
METHODS: dict[Method, str] = {
    "achievements": "learn what achieves what",
    "population": "breed populations, as published",
}


class Trouble:
    """The choice of what may go wrong, which is part of the task."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio = studio
        self.select = ui.select([NONE, *PRESETS], label="What goes wrong")
        self.select.on("update:model-value", page.guard(self._take, steers="task"))
        self.select.props("dense outlined options-dense data-testid=evolve-faults").classes("evolve-faults")
        with self.select:
            ui.tooltip("Parts slip, people move them, the camera loses sight: a tree that is to work in spite of that")
        page.on("task", self.refresh)

    def _take(self) -> None:
        task, name = self.studio.edited.task, self.select.value
        if name == NONE:
            self.studio.edit_task(without_faults(task))
        elif name in PRESETS:
            self.studio.edit_task(with_faults(task, load_faults(name)))

    def refresh(self) -> None:
        """Show what the task says."""
        faults = self.studio.edited.task.faults
        names = {faults: name for name, faults in PRESETS.items()}
        value = NONE if faults is None else names.get(faults, OWN)
        options = [NONE, *PRESETS, *([OWN] if value == OWN else [])]
        self.select.set_options(options, value=value)


class Advanced:
    """The settings, folded away; `settings` returns them."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        gp = studio.evolution.gp
        with ui.expansion("Advanced").props("dense dense-toggle data-testid=evolve-advanced").classes("w-full"):
            with ui.row().classes("items-center gap-2"):
                self.plan = mark(ui.checkbox("Plan first", value=True), "evolve-plan")
                self.population = _number("Population", "evolve-population", gp.population)
                self.generations = _number("Generations", "evolve-generations", gp.generations)
                self.generations.props("placeholder='until solved' stack-label").classes("evolve-generations")
                self.seed = _number("Seed", "evolve-seed", gp.seed)
            with ui.row().classes("items-center gap-2"):
                self.method = ui.select(METHODS, label="Evolution", value=gp.method)
                self.method.props("dense outlined options-dense data-testid=evolve-method").classes("evolve-method")
                ui.label("mutation, %").classes("hint")
                self.add = _number("adds", "evolve-add", round(100 * gp.p_add))
                self.delete = _number("deletes", "evolve-delete", round(100 * gp.p_delete))
                self.change = _number("changes", "evolve-change", round(100 * gp.p_change))

    @property
    def plans(self) -> bool:
        """Whether planning comes first."""
        return bool(self.plan.value)

    def settings(self) -> GPConfig:
        """Return the settings in the fields. Raise UserError for an invalid one."""
        shares = [whole(field, 0, 100) for field in (self.add, self.delete, self.change)]
        if sum(shares) != 100:
            raise UserError(f"what a mutation does sums to {sum(shares)} %; make it 100, under Advanced")
        add, delete, change = (share / 100 for share in shares)
        gp = dataclasses.replace(
            self.studio.evolution.gp,
            method=self.method.value,
            population=whole(self.population, 8, MOST),
            generations=None if self.generations.value is None else whole(self.generations, 1, MOST),
            seed=whole(self.seed, 0, 2**32 - 1),
            p_add=add,
            p_delete=delete,
            p_change=change,
            accept_baseline=False,
            gene_under_fallback=False,
        )
        gp.check()
        return gp


def _number(label: str, testid: str, value: int | None) -> ui.number:
    return whole_field(label, testid, value).classes("evolve-number")
