"""python -m bt_jax.learn: infer a Behavior Tree from recorded demonstrations, say why, and try it in simulation."""

from __future__ import annotations

import sys

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import LearnArguments

__all__ = ["main"]


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(LearnArguments, prog="python -m bt_jax.learn")
    sys.exit(exit_code(lambda: _learn(arguments)))


def _learn(arguments: LearnArguments) -> None:
    from bt_jax.commands.learn import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
