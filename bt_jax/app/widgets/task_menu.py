"""The menu of tasks: those of a person first, then those of the package, each with what it is about."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable, Iterable
from html import escape
from typing import Any

from nicegui import ui

from bt_jax.tasks import load_task, task_names

__all__ = ["listed_tasks", "task_menu"]

OPTION = """
<q-item v-bind="props.itemProps" :aria-label="props.opt.label">
  <q-item-section side class="task-option">{{ props.opt.label }}</q-item-section>
  <q-item-section><q-item-label caption lines="1">{{ (%s)[props.opt.label] || "saved here" }}</q-item-label></q-item-section>
</q-item>
"""


def task_menu(chosen: Callable[..., Any]) -> ui.select:
    """Return an empty menu that calls back once a person has chosen a task."""
    menu = ui.select([], label="Task").on("update:model-value", chosen).classes("task-choice")
    menu.props("dense outlined options-dense popup-content-class=task-menu data-testid=task-choice")
    menu.add_slot("option", OPTION % escape(json.dumps(_descriptions()), quote=False))
    return menu


def listed_tasks(names: Iterable[str]) -> list[str]:
    """Return names of tasks in the order of the menu: a person's own, those of the package, those at YuMi's scale; numbers
    count as numbers."""

    def key(name: str) -> tuple[Any, ...]:
        group = 0 if name not in task_names() else 1 + name.startswith("yumi_")
        parts = re.split(r"(\d+)", name)
        return group, *((part, 0) if i % 2 == 0 else ("", int(part)) for i, part in enumerate(parts))

    return sorted(names, key=key)


@functools.cache
def _descriptions() -> dict[str, str]:
    return {name: load_task(name).description for name in task_names()}
