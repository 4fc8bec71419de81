"""python -m bt_jax.demonstrate: record demonstrations from a script, or watch a person; list, rename, delete them."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import DemonstrateArguments

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _demonstrate(words)))


def _demonstrate(words: Sequence[str] | None) -> None:
    arguments = tyro.cli(DemonstrateArguments, prog="python -m bt_jax.demonstrate", args=words)
    from bt_jax.commands.demonstrate import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
