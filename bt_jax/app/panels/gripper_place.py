"""Where the object in the gripper is, and where it would land."""

from __future__ import annotations

import numpy as np
from nicegui import ui

from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import heading, known
from bt_jax.app.plain_words import slot_at
from bt_jax.app.units import in_millimetres, length
from bt_jax.app.widgets.scene_view import Ghost
from bt_jax.teaching.teleoperation import Landing, Teleoperation

__all__ = ["HeldPlace", "LandingLine"]


class LandingLine:
    """A sentence that says where the held object would land, built into the container that is open, and a translucent copy
    of it there."""

    def __init__(self, page: PanelContext) -> None:
        self.page = page
        self.line = ui.label().classes("teach-landing").props("data-testid=demonstrate-landing role=status")

    def refresh(self, session: Teleoperation, landing: Landing | None) -> None:
        """Show where it would land now."""
        held = session.held
        bad = landing is not None and (landing.inside is not None or landing.on is None)
        self.line.classes(add="teach-bad" if bad else "", remove="" if bad else "teach-bad")
        if landing is None or held is None:
            self.line.set_text("The gripper is empty: pick an object, or finish.")
            self.clear()
            return
        pose = np.array(session.world.poses[0, session.task.object_names.index(held)])
        self.line.set_text(_landing_sentence(session, held, landing))
        if bad:
            self.clear()
            return
        pose[:3] = landing.position
        self.page.scene.ghost({held: Ghost(held, pose, "lands here")}, group="landing")

    def clear(self) -> None:
        """Take the translucent copy out of the scene."""
        self.page.scene.ghost({}, group="landing")


class HeldPlace:
    """A table of where the held object is in every frame, built into the container that is open."""

    def __init__(self) -> None:
        self._shown: object = None
        self._cells: dict[str, list[ui.label]] = {}
        self.title = heading("")
        self.table = ui.element("div").classes("teach-poses").props("data-testid=demonstrate-poses")

    def refresh(self, session: Teleoperation) -> None:
        """Show where it is now."""
        held = session.held
        if (session, held) != self._shown:
            self._shown = (session, held)
            self._build(session, held)
        for frame, cells in self._cells.items():
            values = [_number(in_millimetres(value)) for value in session.position(frame)]
            for cell, text in zip(cells, (*values, f"{_number(session.turn(frame))}°"), strict=True):
                cell.set_text(text)

    def _build(self, session: Teleoperation, held: str | None) -> None:
        self.table.clear()
        self.title.set_text("" if held is None else f"Where {held} is, in mm")
        self._cells = {}
        with self.table:
            for title in () if held is None else ("seen from", "x", "y", "z", "turned"):
                ui.label(title).classes("teach-hint")
            for frame in () if held is None else [name for name in session.task.frames if name != held]:
                ui.label(known(frame, session.task, robot="the robot")).props(f'title="{frame}"')
                self._cells[frame] = [
                    ui.label().props(f"data-testid=demonstrate-pose-{frame}-{key}") for key in ("x", "y", "z", "turn")
                ]


def _number(value: float) -> str:
    """Format with at most one digit after the point, and no minus before zero."""
    return f"{round(float(value), 1) + 0.0:g}".replace("-", "\N{MINUS SIGN}")


def _landing_sentence(session: Teleoperation, held: str, landing: Landing) -> str:
    """Say what happens if the held object is let go now."""
    if landing.inside is not None:
        return f"{held} is inside {landing.inside}: raise it, or carry it aside."
    if landing.on is None:
        return f"Below {held} is only the floor, where the gripper does not reach: carry it over a table."
    drop = float(session.world.poses[0, session.task.object_names.index(held), 2] - landing.position[2])
    where = f"set down on {landing.on}"
    for kit in session.task.kits:
        x, y, z = session.position(kit.name).tolist()
        slot = slot_at(kit, session.task.thing(held), (x, y, z - drop)) if kit.name == landing.on else None
        where = where if slot is None else f"set down in slot {slot.name} of {kit.name}"
    below = f", {length(drop)} below" if drop >= 0.001 else ""
    return f"If you let go now, {held} is {where}{below}."
