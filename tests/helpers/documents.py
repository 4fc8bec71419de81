"""Run what a document shows: the commands and Python snippets of its fenced blocks, in order, in the current folder.

    python -m tests.helpers.documents README.md

`sh` blocks are commands, `python` blocks share one namespace, and a block with `title="NAME"` is a file of that name. A
comment above a block says what a test does otherwise: `<!-- test: not run (REASON) -->`, or `<!-- test: s/OLD/NEW/ -->`,
several of which are separated by semicolons, to run it with smaller numbers.
"""

from __future__ import annotations

import contextlib
import dataclasses
import glob
import os
import re
import runpy
import shlex
import signal
import socket
import subprocess
import sys
import tomllib
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bt_jax._util.startup import configure_jax

ROOT = Path(__file__).parents[2]
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
FENCE = re.compile(
    r"(?:^<!-- test: (?P<marker>[^\n]*?) -->\n\s*)?^```(?P<language>\w+)(?P<rest>[^\n]*)\n(?P<code>.*?)^```$",
    re.M | re.S,
)
SERVER_READY = 60.0  # seconds


@dataclasses.dataclass(frozen=True)
class Block:
    """A fenced block of a document."""

    language: str
    code: str
    title: str | None
    built: bool  # the build of the site runs it, too
    marker: str
    line: int

    @property
    def skipped(self) -> bool:
        """Whether the block is marked as one that a test cannot run."""
        return self.marker.startswith("not run")


def blocks(text: str) -> list[Block]:
    """All fenced blocks of a document, with the replacements of their markers made."""
    found = []
    for match in FENCE.finditer(text):
        title = re.search(r'title="([^"]+)"', match["rest"])
        marker, code = match["marker"] or "", match["code"]
        if marker and not marker.startswith("not run"):
            code = _smaller(code, marker)
        line = text.count("\n", 0, match.start("code")) + 1
        found.append(
            Block(match["language"], code, title and title[1], match["rest"].startswith(" exec"), marker, line)
        )
    return found


def _smaller(code: str, marker: str) -> str:
    for part in marker.split(";"):
        _, old, new, _ = part.strip().split("/")
        if old not in code:
            raise ValueError(f"the marker '{marker}' replaces '{old}', which is not in the block below it")
        code = code.replace(old, new)
    return code


def commands(code: str) -> Iterator[list[str]]:
    """The words of each command of a `sh` block, without comments, with patterns such as runs/stack-* expanded."""
    for line in code.replace("\\\n", " ").splitlines():
        for part in line.split(" && "):
            words = shlex.split(part, comments=True)
            if words:
                yield [name for word in words for name in (sorted(glob.glob(word)) if "*" in word else []) or [word]]


def run_document(path: Path) -> None:
    """Runs every block that is not marked. Raises what fails first, with file and line."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks(path.read_text(encoding="utf-8")):
        if block.skipped:
            continue
        where = f"{path.relative_to(ROOT)}:{block.line}"
        print(f"--- {where}", flush=True)
        try:
            if block.title is not None and block.title != "Output":
                Path(block.title).write_text(block.code, encoding="utf-8")
            elif block.language == "python":
                exec(compile(block.code, where, "exec"), namespace)
            elif block.language == "sh":
                for words in commands(block.code):
                    run_command(words)
        except BaseException as error:
            raise RuntimeError(f"{where}: a block of the document fails") from error


def run_command(words: list[str]) -> None:
    """Runs one command in this process where it is Python. Raise RuntimeError unless its exit code is 0."""
    print("$", shlex.join(words), flush=True)
    match words:
        case ["python", "-m", "pip", "install", *wanted]:
            _check_extras(wanted)
        case ["python", "-m", "bt_jax.app", *rest] | ["bt-jax", "app", *rest]:
            _serve(rest)
        case ["python", "-m", module, *rest]:
            _run_python(rest, lambda: runpy.run_module(module, run_name="__main__", alter_sys=True))
        case ["python", script, *rest]:
            _run_python(rest, lambda: runpy.run_path(script, run_name="__main__"), name=script)
        case ["bt-jax", *rest]:
            module, function = _scripts()["bt-jax"].split(":")
            _run_python(rest, lambda: sys.exit(getattr(__import__(module, fromlist=["_"]), function)()))
        case _:
            subprocess.run(words, check=True)


def _run_python(rest: list[str], work, *, name: str = "python") -> None:
    before, handlers = sys.argv, {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)}
    sys.argv = [name, *rest]
    try:
        work()
    except SystemExit as end:
        if end.code:
            raise RuntimeError(f"exit code {end.code}") from None
    finally:
        sys.argv = before
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _scripts() -> dict[str, str]:
    return _project()["scripts"]


def _check_extras(wanted: list[str]) -> None:
    """An installation is not repeated, but the extras that it names must exist."""
    named = {extra for word in wanted for names in re.findall(r"\[(.*)\]", word) for extra in names.split(",")}
    assert named <= set(_project()["optional-dependencies"]), named


def _serve(rest: list[str]) -> None:
    """Starts the page's server, waits until it answers, and ends it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = [sys.executable, "-m", "bt_jax.app", *rest, "--port", str(port), "--no-show"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        signal.signal(signal.SIGALRM, lambda *_: server.kill())
        signal.alarm(int(SERVER_READY))
        try:
            assert any(f"127.0.0.1:{port}" in line for line in server.stdout), "the server did not say where it is"
            with contextlib.closing(socket.create_connection(("127.0.0.1", port), timeout=1)):
                pass
        except ConnectionRefusedError:
            pass  # the address is printed before the server listens
        finally:
            signal.alarm(0)
            server.send_signal(signal.SIGINT)
            server.wait(timeout=30)


if __name__ == "__main__":
    os.environ.setdefault("COLUMNS", "120")
    configure_jax("cpu")  # snippets keep what they compile, too
    try:
        run_document(Path(sys.argv[1]).resolve())
    except RuntimeError:
        traceback.print_exc()
        sys.exit(1)
