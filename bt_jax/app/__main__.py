"""python -m bt_jax.app: serve the page."""

from __future__ import annotations

import dataclasses
import socket
import sys
from pathlib import Path

import tyro

from bt_jax._util.errors import UserError
from bt_jax._util.startup import configure_jax, exit_code
from bt_jax.app.processes.warm_worker import WarmWorker

__all__ = ["Arguments", "main"]


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Serve the page for teaching a task, evolving a tree for it, watching and correcting."""

    folder: Path = Path()
    """where runs, demonstrations and tasks are kept; created if missing"""
    port: int = 8080
    """of the page"""
    host: str = "127.0.0.1"
    """who may open the page: this machine only, or with 0.0.0.0 everyone in the network, without a password"""
    show: bool = True
    """open a browser"""

    def check(self) -> None:
        """Raise UserError if the page cannot be served at this address."""
        try:
            with socket.socket() as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((self.host, self.port))
        except (OSError, OverflowError) as error:
            raise UserError(
                f"{self.host}:{self.port} cannot be used ({error}); choose another --port or --host"
            ) from None


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(Arguments, prog="python -m bt_jax.app")
    sys.exit(exit_code(lambda: run(arguments)))


def run(arguments: Arguments) -> None:
    """Serve the page until it is interrupted."""
    arguments.check()
    _create(arguments.folder)
    warm_worker = WarmWorker()  # gets ready while the server does; its stdin ends with this process
    try:  # NiceGUI is optional
        from bt_jax.app.server import serve
    except ModuleNotFoundError as error:
        raise UserError(f'{error.name} is not installed; run pip install -e ".[app]"') from error
    configure_jax("cpu")
    print(f"the page is at http://{arguments.host}:{arguments.port} (Ctrl-C ends it; an evolution goes on)", flush=True)
    serve(arguments.folder, host=arguments.host, port=arguments.port, show=arguments.show, warm_worker=warm_worker)


def _create(folder: Path) -> None:
    """Create the workspace. Raise UserError if that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{folder} cannot be created ({error.strerror}); give another --folder") from None


if __name__ in {"__main__", "__mp_main__"}:
    main()
