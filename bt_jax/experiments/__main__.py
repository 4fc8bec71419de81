"""python -m bt_jax.experiments: the paper's experiments 1 to 3, with demonstration and with GP only."""

from __future__ import annotations

import sys

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.experiments.arguments import ExperimentsArguments

__all__ = ["main"]


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(ExperimentsArguments, prog="python -m bt_jax.experiments")
    sys.exit(exit_code(lambda: _experiments(arguments)))


def _experiments(arguments: ExperimentsArguments) -> None:
    from bt_jax.experiments.command import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
