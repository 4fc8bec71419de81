"""The server of the page: one studio, which every window shows."""

from __future__ import annotations

from pathlib import Path

from nicegui import app, ui

from bt_jax.app.page import Page
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace

__all__ = ["serve"]

WATCH_SECONDS = 0.1  # between two looks at the evolution
RECONNECT_SECONDS = 30.0  # for which a window that is not heard of is kept, on a machine that has too much to do


def serve(folder: Path, *, host: str, port: int, show: bool, reserve: WarmWorker) -> None:
    """Serves the page, which works in a folder, until it is interrupted; the first evolution takes the `reserve`."""
    workspace = Workspace(folder)
    studio = Studio(workspace, workspace.task("stack"), reserve)
    studio.find_evolution()

    def prepare() -> None:
        studio.evolution.prepare(studio.task, studio.gp)

    app.on_startup(prepare)
    studio.subscribe("task", prepare)
    studio.subscribe("evolution", prepare)
    app.on_shutdown(studio.evolution.discard_reserve)
    app.timer(WATCH_SECONDS, studio.watch)

    @ui.page("/")
    def window(step: str = "") -> None:
        Page(studio, step)

    ui.run(
        host=host,
        port=port,
        title="bt_jax",
        show=show,
        reload=False,
        reconnect_timeout=RECONNECT_SECONDS,
        show_welcome_message=False,
    )
