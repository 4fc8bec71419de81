"""A training that has imported and compiled what it needs, and waits to be told what to evolve.

The process, python -m bt_jax.app.processes.warm_worker, reads lines of JSON from stdin: ["warm", WORD, ...] compiles for a
training, ["train", WORD, ...] becomes one. The words are those of the command line of `bt_jax.train`. It ends where stdin
ends.
"""

from __future__ import annotations

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
from bt_jax.app.processes.subprocess import NICE, last_words

__all__ = ["WarmWorker"]


class WarmWorker:
    """The side of the page: a process that is ready to train. It outlives the page once it trains."""

    def __init__(self) -> None:
        self.log = tempfile.TemporaryFile()  # noqa: SIM115
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bt_jax.app.processes.warm_worker"],
            stdin=subprocess.PIPE,
            stdout=self.log,
            stderr=self.log,
            start_new_session=True,
        )

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def warm(self, words: Sequence[str]) -> None:
        """Lets it compile for a training with this command line."""
        self._order("warm", words)

    def train(self, words: Sequence[str]) -> None:
        """Lets it train, once it has compiled. Raises UserError where it has died."""
        self._order("train", words)
        self.process.stdin.close()

    def discard(self) -> None:
        """Ends it."""
        self.process.kill()
        self.process.wait()

    def last_words(self) -> str:
        """The last line that it has printed."""
        self.log.seek(0)
        return last_words(self.log.read())

    def _order(self, order: str, words: Sequence[str]) -> None:
        try:
            self.process.stdin.write(json.dumps([order, *words]).encode() + b"\n")
            self.process.stdin.flush()
        except OSError as error:
            raise UserError("the process that should evolve has died; try again") from error


def main() -> None:
    """The side of the process. An order to train ends the compiling of what it does not need any more."""
    from bt_jax._util.startup import configure_jax, exit_code
    from bt_jax.commands.arguments import parse_train
    from bt_jax.commands.train import run, warm

    os.nice(NICE)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    orders: queue.Queue[list[str] | None] = queue.Queue()
    threading.Thread(target=_listen, args=(orders,), daemon=True).start()
    configure_jax("cpu")
    while (order := orders.get()) is not None:
        kind, *words = order
        if kind == "train":
            sys.exit(exit_code(lambda words=words: run(parse_train(words))))
        exit_code(lambda words=words: warm(parse_train(words), until=lambda: not orders.empty()))


def _listen(orders: queue.Queue[list[str] | None]) -> None:
    for line in sys.stdin:
        orders.put(json.loads(line))
    orders.put(None)


if __name__ == "__main__":
    main()
