"""Printing, whatever stdout is: a terminal without arrows, a pipe that nobody reads, a file on a full disk, or closed."""

from __future__ import annotations

import codecs
import io
import os
import sys

__all__ = ["output_lost", "prepare_streams"]

ASCII = str.maketrans("→✓✗…├└│─", ">+x~|`|-") | {ord("±"): "+-"}  # of what our own texts contain
HANDLER = "bt_jax.ascii"


class _Output(io.TextIOWrapper):
    """A text stream that writes into nothing once writing has failed, so that the command goes on."""

    def __init__(self, stream: io.TextIOWrapper) -> None:
        at_once = {"line_buffering": stream.line_buffering, "write_through": stream.write_through}
        super().__init__(stream.buffer, stream.encoding, HANDLER, newline=None, **at_once)
        self._stream = stream  # would close the buffer if nobody held it
        self.lost = False  # what was written, for another reason than that nobody reads it

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self.fileno())  # takes what is still in the buffer
        os.close(nothing)
        self.lost = not isinstance(error, BrokenPipeError)
        problem = f"what this prints cannot be written ({error.strerror})"
        problem = problem if self.lost else "nobody reads what this prints any more"
        print(f"warning: {problem}; the command goes on", file=sys.stderr)


def prepare_streams() -> None:
    """Let the command print any text: what an encoding lacks becomes ASCII, a closed stream takes everything."""
    codecs.register_error(HANDLER, _in_ascii)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever started this process
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=HANDLER)
    if sys.stdout is sys.__stdout__ and type(sys.stdout) is io.TextIOWrapper:
        sys.stdout.flush()
        sys.stdout = _Output(sys.stdout)


def output_lost() -> bool:
    """Write what is still in the buffer of stdout, and return whether any output was lost for want of space."""
    sys.stdout.flush()
    return isinstance(sys.stdout, _Output) and sys.stdout.lost


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Replace what an encoding lacks by similar ASCII, or by an escape such as \\u7bb1."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(ASCII)
    return text.encode("ascii", "backslashreplace").decode(), error.end
