"""What an experiment ran on."""

from __future__ import annotations

import os
import platform
from datetime import date

import jax
import mujoco

__all__ = ["machine"]


def machine() -> str:
    """Return cores, versions and date in one sentence."""
    return (
        f"{os.cpu_count()} cores; jax {jax.__version__}, mujoco {mujoco.__version__}, python {platform.python_version()}; "
        f"{date.today().isoformat()}."
    )
