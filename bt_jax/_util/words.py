"""Small pieces of the sentences that commands print."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Sequence

__all__ = ["clipped", "counted", "listed", "unknown_command"]


def counted(number: int, noun: str) -> str:
    """Return "1 box", "2 boxes": a number and a noun whose plural is regular."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}{'es' if noun.endswith('x') else 's'}"


def unknown_command(word: str, commands: Collection[str]) -> str:
    """Return the sentence about a word that is not one of the commands: with the nearest one, or with all of them."""
    near = difflib.get_close_matches(word, commands, n=1)
    remedy = f"did you mean {near[0]}?" if near else f"choose one of {', '.join(commands)}"
    return f"error: unknown command '{word}'; {remedy}"


def clipped(sentence: str, longest: int = 60) -> str:
    """Return a sentence in which words, and what stands in single quotation marks, are cut off after so many characters."""
    long = rf"(?<=[\s=(])'[^']{{{longest},}}'|[^\s']{{{longest},}}"
    return re.sub(long, lambda found: f"{found[0][: longest - 4]}...{found[0][-1]}", sentence)


def listed(items: Sequence[str], most: int = 8) -> str:
    """Return items separated by commas, and how many more there are than are shown."""
    more = len(items) - most
    return ", ".join([*items[:most], *([f"and {more} more"] if more > 0 else [])])
