"""What all benchmarks share: a table in the terminal, a JSON file, and the machine that it was measured on."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import mujoco
from rich.console import Console
from rich.table import Table

RESULTS = Path(__file__).parent / "results"


def best_seconds(function: Callable[[], Any], *, repeat: int = 5) -> float:
    """Least time of several calls, each awaited; the first call, which may compile, is not counted."""
    jax.block_until_ready(function())
    times = []
    for _ in range(repeat):
        began = perf_counter()
        jax.block_until_ready(function())
        times.append(perf_counter() - began)
    return min(times)


def report(
    name: str,
    title: str,
    rows: Sequence[dict[str, Any]],
    *,
    out: Path | None = None,
    where: dict[str, Any] | None = None,
    **more: Any,
) -> None:
    """Prints rows as a table and writes them, with date and machine (this one, or `where`), to `results/NAME.json` or
    `out`."""
    show(title, rows)
    for key, value in more.items():
        if not isinstance(value, list | dict):
            Console().print(f"{key}: {_text(value)}")
    path = out or RESULTS / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [{key: None if value != value else value for key, value in row.items()} for row in rows]  # NaN: not measured
    content = {"rows": rows, **more, **(machine() if where is None else where)}
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    Console().print(f"written to {path}")


def show(title: str, rows: Sequence[dict[str, Any]]) -> None:
    """Prints rows as a table."""
    table = Table(title=title)
    for column in rows[0]:
        table.add_column(column, justify="left" if isinstance(rows[0][column], str) else "right")
    for row in rows:
        table.add_row(*(_text(value) for value in row.values()))
    Console().print(table)


def machine() -> dict[str, str]:
    """Where and when something was measured."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [
            line.split(":")[1].strip() for line in cpuinfo.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    return {
        "cpu": f"{model}, {os.cpu_count()} cores",
        "device": jax.devices()[0].device_kind,
        "versions": f"jax {jax.__version__}, mujoco {mujoco.__version__}, python {platform.python_version()}",
        "date": date.today().isoformat(),
    }


def _text(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return f"{value:,}" if isinstance(value, int) else str(value)
