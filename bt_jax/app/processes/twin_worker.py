"""The process, python -m bt_jax.app.processes.twin_worker, that does one job with the robot's twin.

It reads the job from stdin, then requests, and ends when stdin does. What it says goes to stdout, see `twin_messages`.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from io import RawIOBase
from typing import BinaryIO

from bt_jax._util.errors import UserError
from bt_jax.app.processes.twin_messages import Ended, Failed, Message, Request, read_job, read_request, to_line

__all__ = ["main"]

PATIENCE = 10.0  # seconds for a job to end in order once the page has gone


def main() -> None:
    """Do the job."""
    speaker = _speaker()
    listener = os.fdopen(
        os.dup(sys.stdin.fileno()), "rb", buffering=0
    )  # a buffer would be locked when this process ends
    job = read_job(listener.readline())
    requests: queue.SimpleQueue[Request] = queue.SimpleQueue()

    def say(message: Message) -> None:
        speaker.write(to_line(message))
        speaker.flush()

    try:
        threading.Thread(target=_listen, args=(listener, requests), daemon=True).start()
        from bt_jax.app.processes import (
            twin_jobs,
        )  # heavy: OpenCV, Pinocchio and a renderer, which only this process needs

        twin_jobs.do(job, requests, say)
    except ModuleNotFoundError as error:
        say(Failed(f'{error.name} is not installed; run pip install -e ".[robot]"'))
    except UserError as error:
        say(Failed(str(error)))
    except KeyboardInterrupt:
        say(Ended("interrupted", 0.0, solved=False, interrupted=True))


def _speaker() -> BinaryIO:
    """Return what was stdout; whatever else is printed goes to stderr from now on."""
    speaker = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return speaker


def _listen(listener: RawIOBase, requests: queue.SimpleQueue[Request]) -> None:
    for line in listener:
        requests.put(read_request(line))
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(PATIENCE)
    os.killpg(os.getpgid(0), signal.SIGKILL)


if __name__ == "__main__":
    main()
