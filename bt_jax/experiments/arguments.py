"""What `python -m bt_jax.experiments` takes, without JAX and MuJoCo: see `bt_jax.commands.arguments`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bt_jax._util.errors import UserError
from bt_jax.commands.arguments import check_out, unset

__all__ = ["ExperimentsArguments"]


@dataclasses.dataclass(frozen=True)
class ExperimentsArguments:
    """Repeat the paper's experiments: evolution with a demonstration, and alone, with the same number of episodes; beside
    them the method achievements, alone. Another experiment, on faults: see `python -m bt_jax.experiments robust --help`."""

    which: Annotated[Literal["1", "2", "3", "all"], tyro.conf.Positional] = "all"
    """the experiment"""
    runs: int = 10
    """independent runs of each variant, side by side"""
    seed: int = 0
    """seed of the first run"""
    test_layouts: int = 100
    """unseen layouts in which each learnt tree is tested"""
    out: Annotated[Path | None, unset("PATH")] = None
    """folder for figures and report (default: runs/experiments-DATE-TIME)"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        for name in ("runs", "test_layouts"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} is {getattr(self, name)}; choose 1 or more")
        check_out(self.out)
