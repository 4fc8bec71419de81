"""A document with a history: what it is now, what it was before, and what was undone."""

from __future__ import annotations

import dataclasses
from typing import Generic, TypeVar

from bt_jax._util.errors import UserError

__all__ = ["History"]

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class History(Generic[T]):
    """An immutable document; a change gives another one, and never alters this one."""

    present: T
    past: tuple[T, ...] = ()  # the oldest first
    future: tuple[T, ...] = ()  # what was undone, the next to redo first

    def changed(self, present: T) -> History[T]:
        """Return the document after a change; what was undone before cannot be redone any more."""
        return History(present, (*self.past, self.present))

    def undone(self) -> History[T]:
        """Return the document before its last change. Raise UserError if there is none."""
        if not self.past:
            raise UserError("there is nothing to undo; change something first")
        *past, present = self.past
        return History(present, tuple(past), (self.present, *self.future))

    def redone(self) -> History[T]:
        """Return the document after the change that was undone last. Raise UserError if there is none."""
        if not self.future:
            raise UserError("there is nothing to redo; undo something first")
        present, *future = self.future
        return History(present, (*self.past, self.present), tuple(future))
