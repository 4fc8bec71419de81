"""Reading the log of a run. Every line stands for itself: its types are checked, and one that is damaged hides no other."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NotRequired, TypedDict

import msgspec

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import read_bytes
from bt_jax.deploy.execution.log import FORMAT

__all__ = ["Damage", "log_ends", "numbered_entries", "read_log"]

BLOCK = 1 << 16  # bytes read at once from the end of a log

Pose = tuple[float, float, float, float, float, float, float]
Joints = tuple[float, float, float, float, float, float, float]
MaybeJoints = tuple[
    float | None, float | None, float | None, float | None, float | None, float | None, float | None
]  # a measurement may be unknown
Statuses = Annotated[str, msgspec.Meta(pattern=r"^[.012]*$")]


class _Start(TypedDict):
    format: int
    time: NotRequired[float]
    tree: NotRequired[str]
    digest: NotRequired[str]
    task: NotRequired[dict[str, Any]]
    limits: NotRequired[dict[str, float]]
    settings: NotRequired[dict[str, Any]]
    dry: NotRequired[bool]
    versions: NotRequired[dict[str, str]]


class _Seen(TypedDict):
    time: float
    poses: dict[str, Pose]
    opening: dict[str, float]
    holding: str | None
    image: float | None


class _Context(TypedDict):
    attempt: str | None
    exhausted: list[str]
    reached: list[str]
    unreachable: list[str]
    last: NotRequired[dict[str, Pose]]


class _Look(TypedDict):
    looking: bool
    looked: float | None
    undecided: list[str]


class _Tick(TypedDict):
    seen: _Seen
    context: _Context
    statuses: Statuses | None
    phase: str
    time: NotRequired[float]
    sight: NotRequired[_Look]


class _Action(TypedDict):
    time: float
    action: str
    event: str
    reason: str
    fault: NotRequired[str]  # of the end of an attempt


class _Motion(TypedDict):
    arm: str
    time: list[float]
    setpoint: list[Joints]
    measured: list[MaybeJoints]


class _Exception(TypedDict):
    text: str


class _End(TypedDict):
    exit_code: int
    reason: NotRequired[str]
    seconds: NotRequired[float]
    ticks: NotRequired[int]
    overruns: NotRequired[int]
    counters: NotRequired[dict[str, int]]


KINDS: Mapping[str, Any] = MappingProxyType(
    {"start": _Start, "tick": _Tick, "action": _Action, "motion": _Motion, "exception": _Exception, "end": _End}
)


class Damage:
    """The numbers of the lines of a log that cannot be read; a strict one raises UserError at the first."""

    def __init__(self, path: Path, *, strict: bool) -> None:
        self.path, self.strict = path, strict
        self.lines: set[int] = set()

    @contextlib.contextmanager
    def noted(self, number: int) -> Iterator[None]:
        """Note line `number` if what is done with it raises."""
        try:
            yield
        except (UserError, ValueError, LookupError, TypeError, RecursionError) as error:
            if self.strict:
                raise UserError(
                    f"{self.path}, line {number} is not part of a log ({error}); give the log as the run has written it"
                ) from error
            self.lines.add(number)

    def __str__(self) -> str:
        first = ", ".join(map(str, sorted(self.lines)[:5]))
        return first if len(self.lines) <= 5 else f"{first} and {len(self.lines) - 5} more"


def read_log(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a log in order, without a last one that was not finished.

    Raise UserError if it is not a log of this version, or if a line is damaged.
    """
    for _, entry in numbered_entries(path, Damage(path, strict=True)):
        yield entry


def numbered_entries(path: Path, damage: Damage) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield each line with its number, from 1. What is damaged is noted and left out; but for a last line that was not
    finished, which is left out only, and for the first one, without which nothing is known: then UserError is raised."""
    content = read_bytes(path)
    lines = content.splitlines()
    if not lines:
        raise UserError(f"{path} is empty; give the log that a run has written")
    yield 1, _start(path, lines[0])
    for number, line in enumerate(lines[1:], start=2):
        unfinished = number == len(lines) and not content.endswith(b"\n")
        with contextlib.suppress(ValueError, RecursionError) if unfinished else damage.noted(number):
            yield number, _entry(line)


def log_ends(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the first line of a log and the last one that can be read, without reading what is between them.

    Raise UserError if it is not a log of this version.
    """
    try:
        with path.open("rb") as file:
            first = file.readline()
            end, tail = file.seek(0, os.SEEK_END), b""
            while len(tail.splitlines()) < 3 and len(tail) < end:  # the last line may be unfinished
                file.seek(max(0, end - len(tail) - BLOCK))
                tail = file.read(min(BLOCK, end - len(tail))) + tail
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error}); give the log that a run has written") from error
    if not first:
        raise UserError(f"{path} is empty; give the log that a run has written")
    start = _start(path, first)
    for line in reversed(tail.splitlines()):
        with contextlib.suppress(ValueError, RecursionError):
            return start, _entry(line)
    return start, start


def _start(path: Path, line: bytes) -> dict[str, Any]:
    """Return the first line of a log. Raise UserError if it is not one of this format."""
    try:
        entry = _entry(line)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is no log (line 1: {error}); give the log that a run has written") from error
    if entry["kind"] != "start" or entry["format"] != FORMAT:
        raise UserError(f"{path} is no log of format {FORMAT}; use the version of bt_jax that wrote it")
    return entry


def _entry(line: bytes) -> dict[str, Any]:
    """Return a line of a log. Raise ValueError if it is not one, RecursionError where it nests too deeply."""
    entry = msgspec.json.decode(line)
    if not isinstance(entry, dict) or not isinstance(entry.get("kind"), str):
        raise ValueError("it has no kind")
    if entry["kind"] in KINDS:
        msgspec.convert(entry, KINDS[entry["kind"]])
    if entry["kind"] == "motion" and not len(entry["time"]) == len(entry["setpoint"]) == len(entry["measured"]):
        raise ValueError("its lists differ in length")
    return entry
