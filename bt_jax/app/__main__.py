"""python -m bt_jax.app: serve the page."""

from __future__ import annotations

import contextlib
import dataclasses
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import tyro

from bt_jax._util.errors import UserError
from bt_jax._util.files import try_lock
from bt_jax._util.startup import configure_jax, exit_code
from bt_jax.app.access.address import is_loopback, is_name, own_address
from bt_jax.app.access.logins import LOGIN_HOURS, new_token
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
    """the address to listen on: this machine only, or with 0.0.0.0 the network, which needs the token that is printed"""
    allow_host: tuple[str, ...] = ()
    """further names that the page is opened under, of this machine or of a reverse proxy; needs the token, too"""
    hold_factor: float = 1.0
    """how many times longer than usual a window that does nothing keeps the gripper, the task or the run from the others"""
    show: bool = True
    """open a browser"""

    @property
    def public(self) -> bool:
        """Whether others than this machine can open the page."""
        return not all(map(is_loopback, (self.host, *self.allow_host)))

    @property
    def names(self) -> frozenset[str]:
        """The names that the page is served under, besides loopback's and the address of the connection."""
        return frozenset(name.lower() for name in (self.host, *self.allow_host) if not is_loopback(name))

    def check(self) -> None:
        """Raise UserError if the page cannot be served at this address or under these names."""
        for name in self.allow_host:
            if not is_name(name):
                raise UserError(f"--allow-host {name} is not the name of a host; give it without http:// and port")
        if not 0.1 <= self.hold_factor <= 1000:
            raise UserError(f"--hold-factor {self.hold_factor:g} is implausible; use 0.1 to 1000")
        try:
            for family, kind, _, _, address in socket.getaddrinfo(self.host, None, type=socket.SOCK_STREAM):
                with socket.socket(family, kind) as probe:
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    if family == socket.AF_INET6:
                        probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)  # as the server does
                    probe.bind((address[0], self.port, *address[2:]))
        except (OSError, OverflowError, UnicodeError) as error:
            raise UserError(
                f"{_authority(self.host, self.port)} cannot be used ({error}); choose another --port or --host"
            ) from None


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(Arguments, prog="python -m bt_jax.app")
    sys.exit(exit_code(lambda: run(arguments)))


def run(arguments: Arguments) -> None:
    """Serve the page until it is interrupted."""
    arguments.check()
    with _claimed(arguments.folder):
        _serve(arguments)


def _serve(arguments: Arguments) -> None:
    warm_worker = WarmWorker()  # gets ready while the server does; its stdin ends with this process
    try:  # NiceGUI is optional
        from bt_jax.app.server import serve
    except ModuleNotFoundError as error:
        raise UserError(f'{error.name} is not installed; run pip install -e ".[app]"') from error
    configure_jax("cpu")
    token = new_token() if arguments.public else ""
    print(_announcement(arguments, token), flush=True)
    path = f"/login?token={token}" if token else "/"
    serve(
        arguments.folder,
        host=arguments.host,
        port=arguments.port,
        names=arguments.names,
        token=token,
        show=path if arguments.show and ":" not in arguments.host else False,  # NiceGUI opens no address of IPv6
        warm_worker=warm_worker,
        hold_factor=arguments.hold_factor,
    )


def _announcement(arguments: Arguments, token: str) -> str:
    """Return what the terminal says of the page: its address, and the token if it needs one."""
    host = own_address() if arguments.host in ("0.0.0.0", "::") else arguments.host
    url = f"http://{_authority(host, arguments.port)}"
    ends = "(Ctrl-C ends it; an evolution goes on)"
    if not token:
        return f"the page is at {url} {ends}"
    return (
        f"the page is at {url}/login?token={token} {ends}\n"
        f"whoever opens {url} without it is asked for the token {token}; a login lasts {LOGIN_HOURS:g} hours"
    )


def _authority(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


@contextlib.contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Create the workspace, and keep other pages out of it: they would replace each other's drafts. Raise UserError if that
    is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / ".page.lock", "wb")  # noqa: SIM115
    except OSError as error:
        raise UserError(f"{folder} cannot be created ({error.strerror}); give another --folder") from None
    with lock:
        if not try_lock(lock):
            raise UserError(f"another page works in {folder}; open that one, or give another --folder")
        yield


if __name__ in {"__main__", "__mp_main__"}:
    main()
