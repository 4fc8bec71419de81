"""MJX, imported without a word: on import, it prints that the optional Warp is missing."""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    from mujoco import mjx

__all__ = ["mjx"]
