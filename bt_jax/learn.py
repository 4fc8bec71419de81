"""python -m bt_jax.learn: infer a Behavior Tree from recorded demonstrations, say why, and try it in simulation."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import LearnArguments

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _learn(words)))


def _learn(words: Sequence[str] | None) -> None:
    arguments = tyro.cli(LearnArguments, prog="python -m bt_jax.learn", args=words)
    from bt_jax.commands.learn import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
