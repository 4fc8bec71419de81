"""Why a task is refused: one sentence with its source, its key as the file has it, and a remedy."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Callable
from typing import NoReturn

from bt_jax._util.errors import UserError
from bt_jax.tasks.written import Keys

__all__ = ["Fail", "Problem", "as_written", "refusal"]

Fail = Callable[[str, str, str], NoReturn]  # key, problem, remedy


@dataclasses.dataclass(frozen=True)
class Problem:
    """What is wrong with a key of a task, such as "objects[2].size", and what to do."""

    key: str
    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.problem}; {self.remedy}"


def refusal(source: str, keys: Keys) -> Fail:
    """Return a function that raises UserError for a key, a problem and a remedy, naming the source."""
    return functools.partial(_fail, source, keys)


def as_written(key: str, keys: Keys) -> str:
    """Return a key as the file has it."""
    begin = max((old for old in keys if re.match(rf"{re.escape(old)}(?![\w[])", key)), key=len, default="")
    return keys.get(begin, "") + key.removeprefix(begin)


def _fail(source: str, keys: Keys, key: str, problem: str, remedy: str) -> NoReturn:
    raise UserError(f"{source}, key {as_written(key, keys)}: {problem}; {remedy}")
