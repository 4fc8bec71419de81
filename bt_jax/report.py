"""python -m bt_jax.report: write a report about a run as one HTML file that prints well."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import datetime

import tyro

from bt_jax._util.files import write_atomic
from bt_jax._util.startup import exit_code
from bt_jax.commands.arguments import ReportArguments

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command line; the words are those after the command (default: those that the process was given)."""
    sys.exit(exit_code(lambda: _report(words)))


def _report(words: Sequence[str] | None) -> None:
    arguments = tyro.cli(ReportArguments, prog="python -m bt_jax.report", args=words)
    from bt_jax.app.report import report  # imports JAX, which --help does without
    from bt_jax.training.run_folder import RunFolder

    out = arguments.out or arguments.run / "report.html"
    write_atomic(out, report(RunFolder(arguments.run), today=datetime.now()))
    print(f"written    {out}")


if __name__ == "__main__":
    main()
