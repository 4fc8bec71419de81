"""python -m bt_jax.train: evolve a Behavior Tree for a task."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import parse_train

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _train(sys.argv[1:] if words is None else words)))


def _train(words: Sequence[str]) -> None:
    arguments = parse_train(words)
    from bt_jax.commands.train import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
