"""python -m bt_jax.run: execute a saved Behavior Tree in simulation, show it tick by tick, film it."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import RunArguments

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _run(words)))


def _run(words: Sequence[str] | None) -> int | None:
    arguments = tyro.cli(RunArguments, prog="python -m bt_jax.run", args=words)
    from bt_jax.commands import run  # imports JAX and MuJoCo, which --help does without

    if arguments.level == "robot":
        return run.robot(arguments)
    run.run(arguments)
    return None


if __name__ == "__main__":
    main()
