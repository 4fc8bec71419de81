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
    """Serve the page on which one teaches, evolves, watches and corrects."""

    folder: Path = Path()
    """where runs, demonstrations and tasks are kept"""
    port: int = 8080
    """of the page"""
    host: str = "127.0.0.1"
    """who may open the page: this machine only, or with 0.0.0.0 everyone in the network, without a password"""
    show: bool = True
    """open a browser"""

    def check(self) -> None:
        """Raises UserError where the page cannot be served like this."""
        if not self.folder.is_dir():
            raise UserError(f"there is no folder {self.folder}; make it, or give another with --folder")
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
    """Serves the page until it is interrupted."""
    arguments.check()
    reserve = WarmWorker()  # gets ready while the server does, and ends with this process where that fails
    try:
        from bt_jax.app.server import serve
    except ModuleNotFoundError as error:
        raise UserError(f'{error.name} is not installed; run pip install -e ".[app]"') from error
    configure_jax("cpu")
    print(f"the page is at http://{arguments.host}:{arguments.port} (Ctrl-C ends it; an evolution goes on)", flush=True)
    serve(arguments.folder, host=arguments.host, port=arguments.port, show=arguments.show, reserve=reserve)


if __name__ in {"__main__", "__mp_main__"}:
    main()
