"""Jobs, several at a time, whose records are kept in a file as they end: a survey that was interrupted goes on. What makes a
record another one's is part of its job: a digest of the code, and of what was run."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import hashlib
import json
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import bt_jax
from bt_jax._util.child_process import end_with_parent
from bt_jax._util.files import write_atomic
from bt_jax.tasks import Task

Job = TypeVar("Job")  # a frozen dataclass of what JSON holds
Record = dict[str, Any]


def code_digest(*more: Path) -> str:
    """Return a digest of the package's files and of some more."""
    package, found = Path(bt_jax.__file__).parent, hashlib.sha256()
    own = [path for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    for path in (*sorted(own), *more):
        found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:12]


def digest_of(task: Task) -> str:
    """Return a digest of a task."""
    return hashlib.sha256(json.dumps(task.to_dict(), sort_keys=True).encode()).hexdigest()[:12]


def stored(path: Path, **only: str) -> list[Record]:
    """Return the records in a file whose values are as in `only`; none if the file is missing."""
    records = json.loads(path.read_text(encoding="utf-8")).get("runs", []) if path.exists() else []
    return [record for record in records if all(record.get(name) == value for name, value in only.items())]


def accumulated(path: Path, jobs: Sequence[Job], work: Callable[[Job], Record], processes: int) -> Iterator[Record]:
    """Yield the record of each job, its fields and what `work` returns for it: those in the file first, then new ones as
    they end and are added to the file."""
    records = stored(path)
    known = [_record_of(job, records) for job in jobs]
    yield from (record for record in known if record is not None)
    missing = [job for job, record in zip(jobs, known, strict=True) if record is None]
    spawn = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(processes, spawn, initializer=end_with_parent) as pool:
        futures = {pool.submit(work, job): job for job in missing}
        for future in concurrent.futures.as_completed(futures):
            records.append({**dataclasses.asdict(futures[future]), **future.result()})
            write_atomic(path, json.dumps({"runs": records}, indent=1) + "\n")
            yield records[-1]


def _record_of(job: Any, records: Sequence[Record]) -> Record | None:
    """Return the record of a job, None if there is none yet."""
    fields = dataclasses.asdict(job).items()
    return next((record for record in records if all(record.get(name) == value for name, value in fields)), None)
