"""python -m bt_jax.train: evolve a Behavior Tree for a task."""

from __future__ import annotations

import sys

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import parse_train

__all__ = ["main"]


def main() -> None:
    """Entry point of the command line."""
    sys.exit(exit_code(_train))


def _train() -> None:
    arguments = parse_train(sys.argv[1:])
    from bt_jax.commands.train import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
