"""The kit that a person begins with."""

from __future__ import annotations

import itertools
from collections.abc import Container

from bt_jax.tasks import Task, parse_task

__all__ = ["new_kit"]

NEW = """
extends: kitting
name: {name}
objects: [{{name: BoxA, size: 0.08, color: [0.95, 0.75, 0.1]}}]
kits: [{{name: TrayA, size: [0.4, 0.3], wall_height: 0.02}}]
targets: []
"""


def new_kit(taken: Container[str]) -> Task:
    """Return a task with a tray and a box, and nothing to do yet; its name is none of those taken."""
    name = next(f"kit_{n}" for n in itertools.count(1) if f"kit_{n}" not in taken)
    return parse_task(NEW.format(name=name), source="the new kit", unfinished=True)
