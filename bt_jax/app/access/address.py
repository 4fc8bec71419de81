"""Names and addresses of hosts."""

from __future__ import annotations

import ipaddress
import re
import socket
from urllib.parse import urlsplit

__all__ = ["host_of", "is_loopback", "is_name", "own_address"]


def is_loopback(name: str) -> bool:
    """Return whether a name always means this machine."""
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return name.lower() in ("localhost", "localhost.localdomain")


def is_name(name: str) -> bool:
    """Return whether a text is the name or the address of a host, without a port."""
    return host_of(f"[{name}]" if ":" in name else name) == name.lower() != ""


def host_of(authority: str) -> str:
    """Return the host of "HOST:PORT", in small letters, empty if it is not valid."""
    if not re.fullmatch(r"\[[0-9A-Fa-f:.]+\](:\d+)?|[\w.-]+(:\d+)?", authority, re.ASCII):
        return ""
    try:
        return urlsplit(f"//{authority}").hostname or ""
    except ValueError:
        return ""


def own_address() -> str:
    """Return the address under which other machines probably reach this one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing; the system chooses the network
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
