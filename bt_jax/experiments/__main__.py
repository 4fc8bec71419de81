"""python -m bt_jax.experiments: the paper's experiments 1 to 3, with demonstration and with GP only; and `robust`, the
experiment on faults."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro

from bt_jax._util.startup import exit_code
from bt_jax.experiments.arguments import ExperimentsArguments
from bt_jax.experiments.robust.arguments import RobustArguments

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _experiments(words)))


def _experiments(words: Sequence[str] | None) -> None:
    words = sys.argv[1:] if words is None else words
    if words and words[0] == "robust":
        robust = tyro.cli(RobustArguments, prog="python -m bt_jax.experiments robust", args=words[1:])
        from bt_jax.experiments.robust.command import run as run_robust  # imports JAX and MuJoCo, as below

        run_robust(robust)
        return
    arguments = tyro.cli(ExperimentsArguments, prog="python -m bt_jax.experiments", args=words)
    from bt_jax.experiments.command import run  # imports JAX and MuJoCo, which --help does without

    run(arguments)


if __name__ == "__main__":
    main()
