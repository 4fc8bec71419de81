"""python -m bt_jax.demonstrate: record demonstrations in simulation from a script; list, rename, delete them."""

from __future__ import annotations

import sys

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import DemonstrateArguments

__all__ = ["main"]


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(DemonstrateArguments, prog="python -m bt_jax.demonstrate")
    sys.exit(exit_code(lambda: _demonstrate(arguments)))


def _demonstrate(arguments: DemonstrateArguments) -> None:
    from bt_jax.commands.demonstrate import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
