"""The page's side of the process that runs, checks or replays a tree on the robot's twin."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence

from bt_jax._util.errors import UserError
from bt_jax.app.processes.subprocess import last_words
from bt_jax.app.processes.twin_messages import Job, Message, Request, read_message, to_line

__all__ = ["TwinProcess"]

WORKER = (sys.executable, "-m", "bt_jax.app.processes.twin_worker")
PATIENCE = 5.0  # seconds for a process that was told to end


class TwinProcess:
    """A process that does one job. It ends with the page, however that ends, and takes its own processes along."""

    def __init__(self, job: Job, command: Sequence[str] = WORKER) -> None:
        self.job = job
        self._log = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, start_new_session=True
        )
        self._heard: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._listener = threading.Thread(target=self._listen, name="twin", daemon=True)
        self._listener.start()
        self.tell(job)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it may still say something."""
        return self._process.poll() is None or self._listener.is_alive() or not self._heard.empty()

    def tell(self, message: Job | Request) -> None:
        """Ask for something. Raise UserError if it has ended."""
        pipe = self._process.stdin
        try:
            if pipe is None or pipe.closed:
                raise BrokenPipeError
            pipe.write(to_line(message))
            pipe.flush()
        except OSError as error:
            raise UserError("the robot's twin has ended; start it again") from error

    def interrupt(self) -> None:
        """Have it end in order; the arms of a run slow down at once."""
        with contextlib.suppress(ProcessLookupError):
            if self._process.poll() is None:
                os.kill(self._process.pid, signal.SIGINT)

    def take(self) -> list[Message]:
        """Return what it has said since this was asked last."""
        heard = []
        with contextlib.suppress(queue.Empty):
            while True:
                heard.append(self._heard.get_nowait())
        return heard

    def close(self) -> None:
        """End it, in order if it does so soon."""
        self.interrupt()
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self) -> None:
        """End it at once; its own processes end when they find it gone."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._listener.join(PATIENCE)

    def last_words(self) -> str:
        """Return the last line that it has printed."""
        self._log.seek(0)
        return last_words(self._log.read())

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.endswith(b"\n"):  # a process that is killed may leave half a line
                self._heard.put(read_message(line))
