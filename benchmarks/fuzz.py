"""Files that are damaged: does every command read them, or refuse them in one sentence?

Each mutant is a valid input with random damage, given to a command's `main`. It must be read, or refused within 2 s of the
processor (as a process, with its start, 4 s) with exit code 2, one sentence on stderr that begins with `error:`, no
traceback, and nothing written or changed. What is told of the valid input, too, by a command that needs more than it, counts
as read. Mutant n of a kind is the same at every call.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import importlib
import io
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track

from benchmarks._fuzz_inputs import KINDS, Call
from benchmarks._fuzz_mutations import mutate
from benchmarks._report import report

__all__ = ["Tried", "judged", "prepare", "tried"]

SECONDS, HANGING = 2.0, 120.0  # of the processor; of the clock
WORKED = "the evolution goes on without it"
LONGEST = 1020  # characters of a sentence


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Mutants of all kinds, read or refused."""

    mutants: int = 20_000
    """how many are given to the commands within this process"""
    processes: int = 100
    """how many are given to a process of their own"""
    kinds: tuple[str, ...] = tuple(KINDS)
    """kinds of inputs"""
    first: int = 0
    """number of the first mutant of each kind"""
    keep: Path | None = None
    """folder for the mutants at which a fault was found"""
    out: Path | None = None
    """where to write the JSON file"""


@dataclasses.dataclass(frozen=True)
class Tried:
    """What became of one mutant. `fault` is "" where it was read, or refused as it should be."""

    damage: str
    words: tuple[str, ...]
    refused: bool
    seconds: float  # of the processor; of a process of its own, with its start
    fault: str


def main(arguments: Arguments) -> int:
    """Print the table and the faults; return 1 if there are any."""
    rows, faults = [], []
    for kind in arguments.kinds:
        with tempfile.TemporaryDirectory() as folder:
            inputs = prepare(kind, Path(folder))
            counts = (arguments.mutants, arguments.processes)
            count, processes = (-(-total // len(arguments.kinds)) for total in counts)
            numbers = range(arguments.first, arguments.first + count)
            found = [tried(kind, n, inputs, keep=arguments.keep) for n in track(numbers, description=kind)]
            outside = [
                tried(kind, n, inputs, keep=arguments.keep, process=True)
                for n in track(range(processes), description=f"{kind}, processes")
            ]
        wrong = [(n, one) for n, one in [*enumerate(found, arguments.first), *enumerate(outside)] if one.fault]
        for what, times in Counter(one.fault for _, one in wrong).most_common():
            number, first = next((n, one) for n, one in wrong if one.fault == what)
            faults.append({"kind": kind, "times": times, "fault": what, "mutant": number, "damage": first.damage})
        rows.append(
            {
                "kind": kind,
                "mutants": len(found),
                "read": sum(not one.refused and not one.fault for one in found),
                "refused": sum(one.refused and not one.fault for one in found),
                "slowest refusal, s": max((one.seconds for one in found if one.refused), default=0.0),
                "processes": len(outside),
                "slowest process, s": max((one.seconds for one in outside if one.refused), default=0.0),
                "faults": len(wrong),
            }
        )
    for fault in faults:
        Console().print(fault)
    report("fuzz", "Mutants", rows, out=arguments.out, faults=faults)
    return int(bool(faults))


@dataclasses.dataclass(frozen=True)
class Inputs:
    """A valid input of one kind in the folder `valid`, and files of other kinds, `strangers`. `told`: what each call says on
    stderr about the valid one, by the call's place; `scratch` is a folder for mutants."""

    valid: Path
    strangers: tuple[Path, ...]
    scratch: Path
    told: tuple[str, ...]


def prepare(kind: str, folder: Path) -> Inputs:
    """Write a valid input of a kind, and files of others; hear what the kind's commands say about the valid one."""
    for name in ("valid", "strangers", "scratch"):
        (folder / name).mkdir()
    with _silent():
        KINDS[kind].make(folder / "valid")
        for name, other in KINDS.items():
            if name not in (kind, "run folder", "demonstrations"):
                other.make(folder / "strangers")
    (folder / "strangers" / "picture.png").write_bytes(bytes.fromhex("89504e470d0a1a0a0000000d49484452"))
    strangers = tuple(sorted(path for path in (folder / "strangers").rglob("*") if path.is_file()))
    inputs = Inputs(folder / "valid", strangers, folder / "scratch", ())
    told = []
    for call in KINDS[kind].calls:
        home = _copied(inputs)
        code, stderr, _, fault = _within(call, call.words(home / "input", home / "out"), home)
        if fault or code not in (0, 1, 2) or (code == 2 and not call.needs_more):
            raise RuntimeError(f"{call.module} does not accept the valid {kind}: {fault or stderr}")
        told.append(stderr)
    return dataclasses.replace(inputs, told=tuple(told))


def tried(kind: str, number: int, inputs: Inputs, *, keep: Path | None = None, process: bool = False) -> Tried:
    """Damage the valid input as `number` says, and give it to one of the kind's commands; `keep` it there at a fault."""
    rng = np.random.default_rng([*kind.encode(), number])
    home = _copied(inputs)
    damage = mutate(home / "input", rng, inputs.strangers)
    place = _choice(KINDS[kind].calls, rng)
    call = KINDS[kind].calls[place]
    words = call.words(home / "input", home / "out")
    before = _digest(home)
    code, stderr, seconds, fault = (_in_process if process else _within)(call, words, home)
    worked = call.works and WORKED in stderr  # it was read, and what it led to could not be written
    refused = code == 2 and stderr != inputs.told[place] and not worked
    changed = _digest(home) != before and (refused or call.needs_more)
    limit = 2 * SECONDS if process else SECONDS
    fault = fault or judged(
        0 if worked else code, stderr, changed=changed, slow=seconds > limit and (refused or not call.works)
    )
    fault = fault.replace(str(home), "")
    if fault and keep is not None:
        kept = keep / f"{kind.replace(', ', '-').replace(' ', '-')}-{number}"
        shutil.copytree(home, kept, symlinks=True, dirs_exist_ok=True)
    return Tried(damage, (call.module, *words), refused, seconds, fault)


def _copied(inputs: Inputs) -> Path:
    """Return a fresh folder with a copy of the valid input, and an empty folder for what is written."""
    home = inputs.scratch / "mutant"
    shutil.rmtree(home, ignore_errors=True)
    shutil.copytree(inputs.valid, home / "input")
    (home / "out").mkdir()
    return home


def _choice(calls: Sequence[Call], rng: np.random.Generator) -> int:
    """Return the place of one of the calls; 0 if none of the rarer ones is drawn."""
    draw = rng.random()
    for place, call in enumerate(calls[1:], start=1):
        if draw < call.share:
            return place
        draw -= call.share
    return 0


def judged(code: int | None, stderr: str, *, changed: bool, slow: bool) -> str:
    """Return what is wrong with what a command did, "" if nothing is."""
    lines = stderr.strip().splitlines()
    if code not in (0, 1, 2):
        return f"exit code {code}"
    if "Traceback" in stderr:
        return f"traceback: {lines[-1][:120]}"
    if slow:
        return "it took too long"
    if code != 2:
        return ""
    if len(lines) != 1 or not lines[0].startswith("error: "):
        return f"{len(lines)} lines on stderr: {' / '.join(lines)[:200]}"
    if len(lines[0]) > LONGEST:
        return f"a sentence of {len(lines[0]):,} characters"
    if not lines[0].isprintable():
        return f"unprintable characters in the sentence: {lines[0][:200]!r}"
    return f"refused, and yet something was written: {lines[0][:120]}" if changed else ""


def _within(call: Call, words: list[str], home: Path) -> tuple[int | None, str, float, str]:
    """Call the command's `main`; return exit code, stderr, seconds of the processor, and the fault if it raised."""
    code: int | None = None
    fault, began = "", time.process_time()
    with _silent() as stderr, contextlib.chdir(home / "out"), _limited(HANGING):
        try:
            code = importlib.import_module(f"bt_jax.{call.module}").main(words) or 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        except BaseException as error:
            frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "bt_jax" in frame.filename]
            where = f"{Path(frames[-1].filename).stem}.{frames[-1].name}" if frames else "?"
            fault = f"{type(error).__name__} in {where}: {str(error).splitlines()[0][:120] if str(error) else ''}"
    seconds = time.process_time() - began
    stderr.flush()
    return code, stderr.buffer.getvalue().decode("utf-8", "replace"), seconds, fault  # type: ignore[attr-defined]


def _in_process(call: Call, words: list[str], home: Path) -> tuple[int | None, str, float, str]:
    """Run the command as a process; return exit code, stderr, seconds of the processor, and that it hangs if it
    does."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    began = _children_seconds()
    try:
        done = subprocess.run(
            [sys.executable, "-m", f"bt_jax.{call.module.removesuffix('.__main__')}", *words],
            cwd=home / "out",
            env=environment,
            capture_output=True,
            timeout=HANGING,
        )
    except subprocess.TimeoutExpired:
        return None, "", HANGING, "it hangs"
    return done.returncode, done.stderr.decode("utf-8", "replace"), _children_seconds() - began, ""


def _children_seconds() -> float:
    """Return the processor's seconds of the processes that were started here and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@contextlib.contextmanager
def _silent() -> Iterator[io.TextIOWrapper]:
    """Keep what is printed; yield stderr."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield err


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError after so many seconds, where this is the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(*_: object) -> None:
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _digest(folder: Path) -> str:
    """Return a digest of all names and contents below a folder."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        found.update(str(path.relative_to(folder)).encode("utf-8", "surrogateescape"))
        if path.is_symlink():
            found.update(os.readlink(path).encode())
        elif path.is_file():
            found.update(path.read_bytes())
    return found.hexdigest()


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Arguments)))
