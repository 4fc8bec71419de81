"""python -m bt_jax.deploy check: look at a real cell before anything moves. Never tried on a robot."""

from __future__ import annotations

from collections.abc import Container

from rich.console import Console

from bt_jax.deploy.commands.arguments import REDUCED_SPEED, CheckArguments
from bt_jax.deploy.commands.real_cell import open_real_cell
from bt_jax.deploy.execution.equipment import Equipment
from bt_jax.deploy.execution.preflight import CheckResult, passed, preflight, show
from bt_jax.deploy.execution.settings import Exit

__all__ = ["check_command", "print_preflight"]


def check_command(arguments: CheckArguments, console: Console | None = None) -> int:
    """Print every item; return 0 where all have passed, else 1."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    with open_real_cell(arguments, motion=False, override=REDUCED_SPEED) as cell:
        items = print_preflight(cell.equipment, console)
    return Exit.DONE if passed(items) else Exit.FAILED


def print_preflight(equipment: Equipment, console: Console, only: Container[str] | None = None) -> list[CheckResult]:
    """Look at everything, or `only` at some items, and print each at once."""
    items = []
    for item in preflight(equipment, only):
        show(console, item)
        items.append(item)
    return items
