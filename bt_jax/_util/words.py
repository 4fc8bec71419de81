"""Small pieces of the sentences that commands print."""

from __future__ import annotations

import difflib
from collections.abc import Collection

__all__ = ["counted", "unknown_command"]


def counted(number: int, noun: str) -> str:
    """Return "1 box", "2 boxes": a number and a noun whose plural is regular."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}{'es' if noun.endswith('x') else 's'}"


def unknown_command(word: str, commands: Collection[str]) -> str:
    """Return the sentence about a word that is not one of the commands: with the nearest one, or with all of them."""
    near = difflib.get_close_matches(word, commands, n=1)
    remedy = f"did you mean {near[0]}?" if near else f"choose one of {', '.join(commands)}"
    return f"error: unknown command '{word}'; {remedy}"
