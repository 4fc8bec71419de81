"""What planning raises."""

from __future__ import annotations

__all__ = ["Unplannable"]


class Unplannable(Exception):
    """There is no way; the message says what was in it."""
