"""Errors as the page says them: without options of commands, and with paths as seen from the page's folder."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from bt_jax._util.errors import UserError

__all__ = ["PHRASES", "phrase", "without_commands", "without_paths"]

PHRASES: Mapping[str, str] = MappingProxyType(  # by the code of the error, where the page has a remedy of its own
    {
        "gene under fallback": "the taught tree cannot be a model to breed from: {problem}; use it as a step on the way",
        "generations reached": "the run is at generation {now} already; go on for one generation or more",
        "new baseline": "there is no new tree that could enter there; let evolution decide where it enters",
        "no tree yet": "the run {run} has no tree yet; let it evolve a generation",
        "too many nodes": "the tree has {nodes} nodes and {room} fit; demonstrate less at once",
    }
)
COMMAND = re.compile(r"(?<![\w-])--[a-z]|python -m |pip install|bt-jax ")
PATH = re.compile(r"(?<![\w.:/~-])/(?:[^\s/'\"]+/)+([^\s/'\"]*)")
INPUTS = re.compile(r"\.inputs/[^/]+/")  # files that the page writes for trainings


def phrase(error: Exception | str, folder: Path) -> str:
    """Return the sentence for an error, or for one that a command has printed; `folder` is that of the page."""
    return without_paths(without_commands(error), folder)


def without_commands(error: Exception | str) -> str:
    """Return the page's phrase for an error; without one, what the error says but for clauses that name a command or an
    option."""
    if isinstance(error, UserError) and error.code in PHRASES:
        return PHRASES[error.code].format(**error.parameters)
    clauses = str(error).split("; ")
    return "; ".join(clause for clause in clauses if not COMMAND.search(clause)) or "this cannot be done on the page"


def without_paths(sentence: str, folder: Path) -> str:
    """Return a sentence in which paths begin in the page's folder, or are only names if they lie elsewhere."""
    for root in (folder.resolve(), folder):
        if str(root) not in (".", "/"):
            sentence = re.sub(rf"(?<![\w/.-]){re.escape(str(root))}/", "", sentence)
            sentence = re.sub(rf"(?<![\w/.-]){re.escape(str(root))}(?![\w/.-])", "the page's folder", sentence)
    return PATH.sub(r"\1", INPUTS.sub("", sentence))
