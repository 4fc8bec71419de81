"""What the page and the process of the robot's twin say to each other: one line of JSON a message."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

__all__ = [
    "Check",
    "Ended",
    "Failed",
    "Item",
    "Job",
    "Message",
    "Person",
    "Picture",
    "Replay",
    "Request",
    "Run",
    "Said",
    "Show",
    "Tick",
    "read_job",
    "read_message",
    "read_request",
    "to_line",
]


class Run(msgspec.Struct, frozen=True, tag=True):
    """Run a tree, in its text form, on the twin, and write a log."""

    tree: str
    task: dict[str, Any]
    seed: int
    log: str


class Check(msgspec.Struct, frozen=True, tag=True):
    """Look at what must be in order before a tree may move the real robot."""

    tree: str
    task: dict[str, Any]
    twin_log: str | None


class Replay(msgspec.Struct, frozen=True, tag=True):
    """Draw moments of a log, as `Show` asks for them."""

    log: str


class Person(msgspec.Struct, frozen=True, tag=True):
    """Have the person in the twin's cell do something, see `deploy.twin.instructed_person.Instruction`."""

    what: Literal["push", "remove", "return", "carry"]
    box: str = ""
    start: tuple[float, float] = (0.0, 0.0)
    end: tuple[float, float] = (0.0, 0.0)


class Show(msgspec.Struct, frozen=True, tag=True):
    """Draw the moment of this number."""

    at: int


class Tick(msgspec.Struct, frozen=True, tag=True):
    """One tick of a run: seconds since its beginning, the status of each node of the expanded tree ("." for none), None
    where it was not ticked, what is done in a word, the action, what is held, what is not known or wrong, what the
    person has taken away, and for each object and kit how long ago it was seen [s], None for never."""

    time: float
    statuses: str | None
    phase: str
    action: str | None
    holding: str | None
    doubts: list[str]
    away: list[str]
    ages: dict[str, float | None]


class Picture(msgspec.Struct, frozen=True, tag=True):
    """A picture as JPEG: of the camera with what is detected in it, or of the whole cell."""

    name: Literal["camera", "cell"]
    jpeg: bytes


class Said(msgspec.Struct, frozen=True, tag=True):
    """What the person in the cell has done, or why it was `refused`."""

    text: str
    refused: bool


class Item(msgspec.Struct, frozen=True, tag=True):
    """One item of the preflight, see `deploy.execution.preflight.CheckResult`."""

    name: str
    passed: bool | None
    detail: str


class Ended(msgspec.Struct, frozen=True, tag=True):
    """How a run ended: `interrupted` by somebody, or for a reason, with its goal `solved` or not."""

    reason: str
    seconds: float
    solved: bool
    interrupted: bool


class Failed(msgspec.Struct, frozen=True, tag=True):
    """The job could not be done, for a reason with a remedy."""

    text: str


Job = Run | Check | Replay
Request = Person | Show
Message = Tick | Picture | Said | Item | Ended | Failed


def to_line(message: Job | Request | Message) -> bytes:
    """Return a message as one line."""
    return msgspec.json.encode(message) + b"\n"


def read_job(line: bytes) -> Job:
    """Read the first line that the page writes."""
    return msgspec.json.decode(line, type=Job)


def read_request(line: bytes) -> Request:
    """Read a later line that the page has written."""
    return msgspec.json.decode(line, type=Request)


def read_message(line: bytes) -> Message:
    """Read a line that the process has written."""
    return msgspec.json.decode(line, type=Message)
