"""What comes to the UDP ports of the arms' EGM, told apart: a message that is of no use says what is set up wrongly."""

from __future__ import annotations

import contextlib
import dataclasses
import ipaddress
import select
import socket
import time
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.egm import CYCLE, SIX, WrongAxes

__all__ = ["USUAL_PORTS", "Receiver", "Reception", "complaint", "open_socket", "senders", "title"]

USUAL_PORTS = range(6510, 6516)  # where a controller sends whose transmission protocols were left as in the manual
LOST = 0.02  # share of messages that may be lost
NUMBERS = 1 << 32  # of messages, after which they begin again
SLOW = 1.5  # of a cycle between two messages: the controller was asked for another rate


@dataclasses.dataclass(frozen=True)
class Reception:
    """Messages at the port of one arm since the link was opened, by what became of them."""

    taken: int = 0
    old: int = 0  # numbered like one before, or lower
    sources: int = 0  # taken ones that came from another port of the controller than the one before
    foreign: int = 0  # from another address than the controller's
    axes: int = 0  # of EGM, but not about as many axes as the arm has
    unreadable: int = 0  # not of EGM
    sequence: int = 0  # number of the last message that was taken
    time: float = 0.0  # its time [s], by the controller's clock
    first: int = 0  # number of the first message that was taken since the numbers began
    first_time: float = 0.0  # its time, s
    address: int = 0  # IPv4 address of the last foreign message
    joints: int = 0  # axes and external axes of the last message that was not about so many
    external: int = 0

    @property
    def silent(self) -> bool:
        """Did nothing come at all?"""
        return not (self.taken or self.old or self.foreign or self.axes or self.unreadable)

    def since(self, before: Reception) -> Reception:
        """Return what came after `before`; the properties of the last messages stay those of the last messages."""
        counts = ("taken", "old", "sources", "foreign", "axes", "unreadable")
        return dataclasses.replace(self, **{name: getattr(self, name) - getattr(before, name) for name in counts})

    def numbers(self) -> Float[np.ndarray, " fields"]:
        """Return it as shared memory holds it."""
        return np.array(list(vars(self).values()), float)

    @staticmethod
    def of(numbers: Float[np.ndarray, " fields"]) -> Reception:
        """Read what `numbers` returns."""
        values = numbers.tolist()
        fields = dataclasses.fields(Reception)
        return Reception(*(v if isinstance(f.default, float) else int(v) for f, v in zip(fields, values, strict=True)))


class Receiver:
    """Counts the messages of one arm."""

    def __init__(self) -> None:
        self.reception = Reception()
        self._source: tuple[str, int] | None = None

    def take(self, source: tuple[str, int], sequence: int, time: float) -> None:
        """Count a message that was taken."""
        known, self._source = self._source, source
        now = self.reception
        if now.taken == 0 or (sequence - now.sequence) % NUMBERS >= NUMBERS // 2:  # they have begun again
            self._set(first=sequence, first_time=time)
        self._set(
            taken=now.taken + 1, sources=now.sources + (known not in (None, source)), sequence=sequence, time=time
        )

    def drop_old(self) -> None:
        """Count a message that is older than one before."""
        self._set(old=self.reception.old + 1)

    def drop_foreign(self, host: str) -> None:
        """Count a message from an address that is not the controller's."""
        self._set(foreign=self.reception.foreign + 1, address=int(ipaddress.IPv4Address(host)))

    def drop_invalid(self, problem: ValueError) -> None:
        """Count a message that cannot be used, for the reason that `Feedback.decode` gave."""
        if isinstance(problem, WrongAxes):
            self._set(axes=self.reception.axes + 1, joints=problem.joints, external=problem.external)
        else:
            self._set(unreadable=self.reception.unreadable + 1)

    def _set(self, **changes: float | int) -> None:
        self.reception = dataclasses.replace(self.reception, **changes)  # type: ignore[arg-type]


def open_socket(port: int) -> socket.socket:
    """Return a UDP socket on every interface; the controller knows our port and speaks first."""
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        found.bind(("", port))
    except OSError:
        found.close()
        raise
    found.setblocking(False)
    return found


def senders(ports: Iterable[int], seconds: float) -> dict[int, str]:
    """Listen at ports for a while; return those to which something came, with the address of its sender. Ports that
    another program uses are left out."""
    with contextlib.ExitStack() as stack:
        sockets = dict(_opened(ports, stack))
        found: dict[int, str] = {}
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0 and sockets:
            for ready in select.select(list(sockets), [], [], left)[0]:
                with contextlib.suppress(OSError):
                    found[sockets[ready]] = ready.recvfrom(4096)[1][0]
        return found


def _opened(ports: Iterable[int], stack: contextlib.ExitStack) -> Iterator[tuple[socket.socket, int]]:
    for port in ports:
        with contextlib.suppress(OSError):
            yield stack.enter_context(open_socket(port)), port


def title(arm: str) -> str:
    """Return what an arm is called in a sentence: the only one of a robot is named "arm"."""
    return "the arm" if arm == "arm" else f"the {arm} arm"


def complaint(
    arm: str, port: int, host: str, before: Reception, after: Reception, seconds: float, *, axes: int
) -> str | None:
    """Return what is wrong with the messages that came to the port of an arm with so many `axes` between two looks,
    `seconds` apart, and what to do about it; None where they are as they should be. Something must have come."""
    came = after.since(before)
    where = f"came to UDP port {port}, meant for {title(arm)},"
    if came.taken > 0:
        return _irregular(arm, port, before, after, seconds)
    if came.axes > 0:
        return (
            f"{came.axes} EGM messages {where} with {came.joints} joints and {came.external} external ones instead of {SIX} "
            f"and {axes - SIX}: another robot, or another EGM setup; give the address of this robot with --robot, and start "
            f"its program, which must guide {axes} axes"
        )
    if came.unreadable > 0:
        return (
            f"{came.unreadable} messages {where} that are not of EGM; choose other ports, with --ports and in the "
            "controller's UDPUC transmission protocols"
        )
    if came.old > 0:
        return f"{came.old} messages {where} whose numbers do not rise; restart the program on the controller"
    sender = ipaddress.IPv4Address(came.address)
    return (
        f"{came.foreign} messages {where} from {sender} and none from {host}; if {sender} is the controller, give it with "
        "--robot, else end what sends them"
    )


def _irregular(arm: str, port: int, before: Reception, after: Reception, seconds: float) -> str | None:
    """Return what is wrong with how often messages come, if anything."""
    came, expected = after.since(before), seconds / CYCLE
    if came.sources > LOST * expected:
        return (
            f"messages of two senders come to UDP port {port}; give each arm a port of its own, with --ports and in the "
            "controller's UDPUC transmission protocols"
        )
    if came.axes + came.unreadable > LOST * expected:
        return f"messages of another kind come to UDP port {port}, too; end what sends them, or choose other --ports"
    goes_on = before.taken > 0 and (after.first, after.first_time) == (before.first, before.first_time)
    number, then = (before.sequence, before.time) if goes_on else (after.first, after.first_time)
    steps = (after.sequence - number) % NUMBERS
    lost = max(steps + (not goes_on) - came.taken, 0)
    period = (after.time - then) / steps if steps else CYCLE
    if not abs(period) < SLOW * CYCLE:
        return (
            f"the messages of {title(arm)} come every {1000 * period:.0f} ms instead of every {1000 * CYCLE:.0f}; set "
            f"SampleRate to {1000 * CYCLE:.0f} where EGM is started, as BtJax does"
        )
    if not (came.taken >= (1 - LOST) * expected and lost <= LOST * expected):
        return (
            f"only {came.taken} of {expected:.0f} messages of {title(arm)} came in {seconds:g} s, {lost} were lost; use a "
            "cable and no other load"
        )
    return None
