"""python -m bt_jax.app: serve the page."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import tyro
from nicegui import app, ui

from bt_jax.app.page import Page
from bt_jax.app.studio import Studio
from bt_jax.app.workspace import Workspace
from bt_jax.startup import configure_jax, exit_code

__all__ = ["Arguments", "main"]

WATCH_SECONDS = 0.1  # between two looks at the evolution


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Serve the page on which one teaches, evolves, watches and corrects."""

    folder: Path = Path()
    """where runs, demonstrations and tasks are kept"""
    port: int = 8080
    """of the page"""
    host: str = "127.0.0.1"
    """who may open the page: this machine only, or with 0.0.0.0 everyone in the network, without a password"""
    show: bool = True
    """open a browser"""


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(Arguments, prog="python -m bt_jax.app")
    sys.exit(exit_code(lambda: serve(arguments)))


def serve(arguments: Arguments) -> None:
    """Serves the page until it is interrupted."""
    configure_jax("cpu")
    workspace = Workspace(arguments.folder)
    studio = Studio(workspace, workspace.task("stack"))
    studio.find_evolution()

    def prepare() -> None:
        studio.evolution.prepare(studio.task, studio.gp)

    app.on_startup(prepare)
    studio.subscribe("task", prepare)
    studio.subscribe("evolution", prepare)
    app.on_shutdown(studio.evolution.discard_reserve)
    app.timer(WATCH_SECONDS, studio.watch)
    ui.run(
        lambda: Page(studio),
        host=arguments.host,
        port=arguments.port,
        title="bt_jax",
        show=arguments.show,
        reload=False,
        show_welcome_message=False,
    )


if __name__ in {"__main__", "__mp_main__"}:
    main()
