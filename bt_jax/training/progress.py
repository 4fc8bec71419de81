"""What a training says of itself to other processes while it runs: `progress.json` in its run folder.

Whether a process trains there is told by a lock on `training.lock`, which ends with the process however that ends.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Literal

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.gp.evolution import Generation

__all__ = ["Progress", "Reporter", "is_alive", "locked", "read_progress"]

Stage = Literal["starting", "evolving", "testing", "finished", "stopped", "failed"]
SECONDS = 0.2  # between two writings of generations, at least
LOCK = "training.lock"
ROWS = 500  # of the history that are kept, at most
LOCK_SECONDS = 1.0  # `is_alive` holds the lock for a moment


@dataclasses.dataclass(frozen=True)
class Progress:
    """Where a training is. Fitness is the best over its runs, and the mean of their means.

    `history` has rows of generation, best and mean; of long trainings, some hundreds evenly chosen, and the last.
    """

    pid: int
    stage: Stage = "starting"
    generation: int = 0
    generations: int = 0
    episodes: int = 0
    best: float | None = None
    mean: float | None = None
    tree: str = ""  # the best so far, on one line
    message: str = ""  # why it failed
    history: tuple[tuple[int, float, float], ...] = ()

    def with_history(self, rows: Sequence[Generation]) -> Progress:
        """This with everything that follows from the history of a training: one row a generation and run, in their order."""
        if not rows:
            return self
        runs = rows[-1].run + 1
        history = tuple(
            (
                some[0].generation,
                round(max(row.best for row in some), 2),
                round(sum(row.mean for row in some) / runs, 2),
            )
            for some in (rows[i * runs : (i + 1) * runs] for i in _chosen(len(rows) // runs))
        )
        generation, best, mean = history[-1]
        episodes = sum(row.episodes for row in rows[-runs:])
        return dataclasses.replace(
            self, generation=generation, episodes=episodes, best=best, mean=mean, history=history
        )


class Reporter:
    """Writes the progress of this process into a run folder; without one, it does nothing. As a context, it also says that
    the training has failed or was interrupted. What was reported before is kept until there is news. A report that cannot be
    written is left out: the training goes on.
    """

    def __init__(self, folder: Path | None, generations: int) -> None:
        self._folder, self._written = folder, 0.0
        before = None if folder is None else read_progress(folder)
        new = {"pid": os.getpid(), "stage": "starting", "generations": generations, "message": ""}
        self._now = dataclasses.replace(before or Progress(0), **new)

    def __enter__(self) -> Reporter:
        self._write()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if isinstance(error, KeyboardInterrupt):
            self.stage("stopped")
        elif error is not None:
            said = str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {error}"
            self._now = dataclasses.replace(self._now, message=said)
            self.stage("failed")

    def stage(self, stage: Stage) -> None:
        """Another part of the work begins, or the last has ended."""
        self._now = dataclasses.replace(self._now, stage=stage)
        self._write()

    def update(self, history: Sequence[Generation], tree: Callable[[], str], *, now: bool = False) -> None:
        """A generation was evolved; `tree` makes the best tree as one line. Written at most five times a second, except the
        first, and what should be written `now`."""
        if self._now.stage == "starting":
            self._now, now = dataclasses.replace(self._now, stage="evolving"), True
        if self._folder is not None and (now or time.monotonic() - self._written >= SECONDS):
            self._now = dataclasses.replace(self._now, tree=tree()).with_history(history)
            self._write()

    def _write(self) -> None:
        if self._folder is None:
            return
        self._written = time.monotonic()
        with contextlib.suppress(UserError):
            write_atomic(self._folder / "progress.json", json.dumps(dataclasses.asdict(self._now)) + "\n")


def _chosen(count: int) -> list[int]:
    """Numbers below `count`: all, or as many as are kept, the first and the last among them."""
    if count <= ROWS:
        return list(range(count))
    return [round(i * (count - 1) / (ROWS - 1)) for i in range(ROWS)]


def read_progress(folder: Path) -> Progress | None:
    """The progress of the training in a run folder; None where there is none that can be read."""
    try:
        data = json.loads((folder / "progress.json").read_text(encoding="utf-8"))
        return Progress(**{**data, "history": tuple(map(tuple, data["history"]))})
    except (OSError, ValueError, TypeError, KeyError):
        return None


def is_alive(folder: Path) -> bool:
    """Whether a process is training in a run folder."""
    try:
        with open(folder / LOCK, "rb") as file:
            return not _lock(file, shared=True)
    except OSError:
        return False


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keeps other processes from training in a run folder meanwhile. Raises UserError where one does already."""
    folder.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with open(folder / LOCK, "wb") as file:
        while not _lock(file, shared=False):
            if time.monotonic() - began > LOCK_SECONDS:
                raise UserError(f"another process is training in {folder}; wait until it has ended, or stop it")
            time.sleep(0.02)
        yield


def _lock(file: IO[bytes], *, shared: bool) -> bool:
    """Whether the lock of an open file could be had; it is given back when the file is closed. Where a system has no such
    locks, it always can."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
