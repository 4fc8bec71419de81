"""A training process that has imported and compiled what it needs, and waits to be told what to evolve.

The process, python -m bt_jax.app.processes.warm_worker, reads lines of JSON from stdin: ["warm", WORD, ...] compiles for a
training, ["train", WORD, ...] becomes one. The words are those of the command line of `bt_jax.train`. It ends when stdin
does.
"""

from __future__ import annotations

import functools
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence

from bt_jax._util.errors import UserError
from bt_jax.app.phrases import without_commands
from bt_jax.app.processes.subprocess import NICE, last_words

__all__ = ["WarmWorker", "main"]


class WarmWorker:
    """The page's side: a process that is ready to train. Once it trains, it outlives the page."""

    def __init__(self) -> None:
        self._log = tempfile.TemporaryFile()  # noqa: SIM115
        # While it waits, it leaves the memory of a GPU to others.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "bt_jax.app.processes.warm_worker"],
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=self._log,
            start_new_session=True,
            env={"XLA_PYTHON_CLIENT_PREALLOCATE": "false", **os.environ},
        )

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    @property
    def failed(self) -> bool:
        """Whether it has ended with an error, not by a signal."""
        return (self._process.poll() or 0) > 0

    def warm(self, words: Sequence[str]) -> None:
        """Tell it to compile for a training with this command line."""
        self._tell("warm", words)

    def train(self, words: Sequence[str]) -> None:
        """Tell it to train, once it has compiled. Raise UserError if it has died."""
        self._tell("train", words)
        if self._process.stdin is not None:
            self._process.stdin.close()

    def discard(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()

    def last_words(self) -> str:
        """Return the last line that it has printed."""
        self._log.seek(0)
        return last_words(self._log.read())

    def _tell(self, verb: str, words: Sequence[str]) -> None:
        pipe = self._process.stdin
        try:
            if pipe is None or pipe.closed:
                raise BrokenPipeError
            pipe.write(json.dumps([verb, *words]).encode() + b"\n")
            pipe.flush()
        except OSError as error:
            raise UserError("the process that should evolve has died; try again") from error


def main() -> None:
    """The process's side. A request to train ends the compiling of what it does not need."""
    # Imported here: the page imports this module and shall not wait for JAX.
    from bt_jax._util.startup import configure_jax, exit_code
    from bt_jax.commands.arguments import parse_train
    from bt_jax.commands.train import run, warm

    requests: queue.Queue[list[str] | None] = queue.Queue()

    def evolve(words: list[str]) -> None:
        try:
            run(parse_train(words))
        except UserError as error:
            raise UserError(without_commands(error)) from error  # the page reads it

    def compile_for(words: list[str]) -> None:
        warm(parse_train(words), until=lambda: not requests.empty())

    os.nice(NICE)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    configure_jax()
    while (request := requests.get()) is not None:
        verb, *words = request
        if verb == "train":
            sys.exit(exit_code(functools.partial(evolve, words)))
        exit_code(functools.partial(compile_for, words))


def _listen(requests: queue.Queue[list[str] | None]) -> None:
    for line in sys.stdin:
        requests.put(json.loads(line))
    requests.put(None)


if __name__ == "__main__":
    main()
