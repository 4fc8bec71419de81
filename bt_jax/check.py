"""python -m bt_jax.check: read files and folders without running anything, and say what they are and what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import CheckArguments

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _check(words)))


def _check(words: Sequence[str] | None) -> int:
    arguments = tyro.cli(CheckArguments, prog="python -m bt_jax.check", args=words)
    from bt_jax.commands.check import run  # imports JAX, which --help does without

    return run(arguments)


if __name__ == "__main__":
    main()
