"""Who steers what all windows share: one window at a time, until it lets go or does nothing for a while."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from types import MappingProxyType
from typing import Literal

from bt_jax._util.errors import UserError
from bt_jax.app.state.bus import Bus

__all__ = ["IDLE_SECONDS", "Holds", "Shared", "Window"]

Shared = Literal["gripper", "task", "run"]
IDLE_SECONDS = MappingProxyType({"gripper": 30.0, "task": 10.0, "run": 5.0})  # after the last input of who has it
NAMES = MappingProxyType({"gripper": "the gripper", "task": "the task", "run": "the running tree"})


@dataclasses.dataclass(frozen=True)
class Window:
    """A window of the page, on the computer with this address."""

    id: str
    address: str


class Holds:
    """Changes are announced under the topic "holds", and so are refusals: what was chosen in vain is then shown as it is.
    Times are of `clock`, seconds; a window
    that does nothing keeps what it has for `factor` times `IDLE_SECONDS`."""

    def __init__(self, bus: Bus, clock: Callable[[], float] = time.monotonic, factor: float = 1.0) -> None:
        self._bus, self._clock, self._factor = bus, clock, factor
        self._held: dict[Shared, tuple[Window, float]] = {}  # who has it, and until when if it does nothing

    def take(self, thing: Shared, window: Window) -> None:
        """Let a window steer something, as long as it goes on doing so. Raise UserError if another one does."""
        if self.other(thing, window) is not None:
            self._bus.changed("holds")
            raise UserError(self.sentence(thing, window))
        before = self._held.get(thing)
        self._held[thing] = window, self._clock() + self._idle(thing)
        if before is None or before[0] != window:
            self._bus.changed("holds")

    def let_go(self, window: Window) -> None:
        """End whatever a window steers."""
        self._keep(lambda holder, ends: holder != window)

    def expire(self) -> None:
        """Announce what is free because its window has done nothing for a while; to be called now and then."""
        now = self._clock()
        self._keep(lambda holder, ends: ends > now)

    def other(self, thing: Shared, window: Window) -> Window | None:
        """Return the other window that steers something, None if this one may."""
        holder, ends = self._held.get(thing, (window, 0.0))
        return holder if holder != window and ends > self._clock() else None

    def sentence(self, thing: Shared, window: Window) -> str:
        """Say to a window who steers something instead of it, and when it may; nothing if it may now."""
        holder = self.other(thing, window)
        if holder is None:
            return ""
        where = "on this computer" if holder.address == window.address else f"at {holder.address}"
        return (
            f"another window {where} has {NAMES[thing]}; wait until it is closed, goes to another step, or has done "
            f"nothing for {self._idle(thing):g} seconds"
        )

    def _idle(self, thing: Shared) -> float:
        return self._factor * IDLE_SECONDS[thing]

    def _keep(self, keep: Callable[[Window, float], bool]) -> None:
        kept = {thing: held for thing, held in self._held.items() if keep(*held)}
        if kept != self._held:
            self._held = kept
            self._bus.changed("holds")
