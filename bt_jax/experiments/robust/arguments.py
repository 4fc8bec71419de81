"""What `python -m bt_jax.experiments robust` takes, without JAX and MuJoCo."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import tyro

from bt_jax._util.errors import UserError
from bt_jax.tasks.faults import FAULTS

__all__ = ["RobustArguments"]


@dataclasses.dataclass(frozen=True)
class RobustArguments:
    """Test trees that were evolved without faults, evolved with them, planned and demonstrated in the same episodes, under
    every fault alone and under all together. What is finished stays if this is stopped; the same command goes on."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ("stack3", "kit6")
    """tasks without faults, by name or as YAML files"""
    faults: str = "harsh"
    """what goes wrong: mild, harsh, or a YAML file"""
    held_out: tuple[str, ...] = ("take", "heavy")
    """faults that evolution and planner do not know, only the tests"""
    seeds: int = 10
    """evolutions of each kind"""
    seed: int = 0
    """seed of the first; the tests have the same layouts and draws whatever it is"""
    layouts: int = 200
    """unseen layouts in which every tree is tested"""
    draws: int = 5
    """draws of chance in each of them"""
    out: Path = Path("runs/robust")
    """folder for results, figure and report"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        for name in ("seeds", "layouts", "draws"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} is {getattr(self, name)}; choose 1 or more")
        if unknown := [name for name in self.held_out if name not in FAULTS]:
            raise UserError(f"held_out: there is no fault '{unknown[0]}'; choose from {', '.join(FAULTS)}")
