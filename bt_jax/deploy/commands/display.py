"""What a run shows while it goes on: the tree with the status of every node, and what the robot sees, knows and doubts."""

from __future__ import annotations

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text
from scipy.spatial.transform import Rotation

from bt_jax.behaviors import expand
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.planning.grasps import yaw_of
from bt_jax.deploy.planning.pose_geometry import heading
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task

__all__ = ["RunDisplay", "doubts", "sight_table"]

STYLES = {Status.SUCCESS: "green", Status.FAILURE: "red", Status.RUNNING: "bold yellow", None: "dim"}


class RunDisplay:
    """Live on a terminal; elsewhere a line for every change. Use it as a context manager."""

    def __init__(self, program: Program, console: Console) -> None:
        self.task, self.tree, self.console = program.task, expand(program.tree), console
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._last, self._doubts = "", list[str]()
        self._lines = Text()
        self._began: float | None = None

    def __enter__(self) -> RunDisplay:
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def update(self, shown: TickReport, event: str = "") -> None:
        """Show a tick, and what happened to the cell meanwhile."""
        seen = shown.seen
        self._began = seen.time if self._began is None else self._began
        if event:
            self._print(seen, event, "magenta")
        doing = f"{shown.phase} {shown.action or ''}"
        if doing != self._last:
            self._print(seen, doing)
        before, self._last, self._doubts = self._doubts, doing, doubts(self.task, seen)
        for doubt in self._doubts:
            if doubt not in before:
                self._print(seen, doubt, "yellow")
        if not self.console.is_terminal:
            return
        if shown.statuses is not None:
            lines = draw_text(self.tree, shown.statuses).splitlines()
            self._lines = Text("\n").join(
                Text(line, STYLES[status]) for line, status in zip(lines, shown.statuses, strict=True)
            )
        self._live.update(Group(self._lines, sight_table(self.task, seen)), refresh=True)

    def _print(self, seen: Observation, text: str, style: str = "") -> None:
        assert self._began is not None
        out = self._live.console if self.console.is_terminal else self.console
        out.print(Text(f"{seen.time - self._began:7.1f} s  {text}", style))


def sight_table(task: Task, seen: Observation) -> Table:
    """Return what is known of each box and the kit, in the robot's base frame, and what is wrong with the picture."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("object", "x mm", "y mm", "z mm", "turned", "seen", ""):
        table.add_column(title, justify="left" if title in ("object", "") else "right")
    for name in (*task.object_names, *task.kit_names):
        why = "; ".join(finding.text for finding in seen.findings if finding.about == name)
        if name == seen.holding:
            why = "; ".join(filter(None, ["in the hand", why]))
        age = f"{seen.time - seen.measured[name]:.1f} s ago" if name in seen.measured else "never"
        if name in seen.poses:
            x, y, z = 1000 * seen.poses[name].translation
            turned = _turned(task, name, seen.poses[name].rotation)
            table.add_row(name, f"{x:.0f}", f"{y:.0f}", f"{z:.0f}", turned, age, why)
        else:
            table.add_row(name, "", "", "", "", age, why or "unknown", style="yellow")
    for finding in seen.findings:
        if finding.about not in (*task.object_names, *task.kit_names):
            table.add_row(finding.about or "picture", "", "", "", "", "", finding.text, style="yellow")
    return table


def _turned(task: Task, name: str, rotation: Rotation) -> str:
    """Return how an object is turned about the vertical, up to turns in which it looks alike; of a cylinder nothing."""
    thing = task.thing(name) if name in task.object_names else None
    if thing is None or thing.is_cube:
        return f"{np.degrees(yaw_of(rotation)):.0f} deg"
    return f"{np.degrees(heading(rotation)) % thing.symmetry:.0f} deg" if thing.symmetry else ""


def doubts(task: Task, seen: Observation) -> list[str]:
    """Return what is not known, or is wrong with the picture, each a line."""
    unknown = [name for name in (*task.object_names, *task.kit_names) if name not in (*seen.poses, seen.holding)]
    told = {finding.about for finding in seen.findings}
    return [
        *(finding.text for finding in seen.findings),
        *(f"{name} is not seen" for name in unknown if name not in told),
    ]
