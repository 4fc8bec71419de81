"""Playbacks as films and pictures."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.episodes.playback import Playback
from bt_jax.mjx_env.render.choreography import shots
from bt_jax.mjx_env.render.offscreen import INSTALL, Renderer, available, write_film
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Task

__all__ = ["check_film", "film", "final_picture"]

STYLES = {".mp4": (800, 450, 30.0), ".gif": (480, 270, 12.5), ".png": (640, 336, 30.0)}  # width, height, frames/s
SHEET = 6  # pictures on a contact sheet


def check_film(path: Path) -> None:
    """Raise UserError, before any work is done, if no film can be written to `path` or nothing can be drawn here."""
    if path.suffix.lower() not in STYLES:
        raise UserError(f"{path} is not a film; let its name end in {', '.join(STYLES)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise UserError(f"{path} cannot be written; name a file in a folder that exists and that you may write to")
    if (reason := available()) is not True:
        raise UserError(f"films cannot be drawn here: {reason}; {INSTALL}")


def film(
    path: Path, semantics: LeafSemantics, playback: Playback, *, progress: Callable[[float], None] = lambda part: None
) -> None:
    """Write a film (.mp4, .gif) or a sheet of stills with captions (.png); `progress` is called with the share that is done.

    Raises UserError as `check_film` does, and if the file cannot be written.
    """
    check_film(path)
    width, height, fps = STYLES[path.suffix.lower()]
    takes = shots(semantics, playback, fps=fps)
    stills = path.suffix.lower() == ".png"
    if stills:
        takes = [takes[round(i)] for i in np.linspace(0, len(takes) - 1, SHEET)]
    kits, frames, last = playback.start.kits[0], [], None
    with Renderer(semantics.task, width=width, height=height) as renderer:
        for shot in takes:
            caption = shot.caption if stills else ""
            frames.append(frames[-1] if shot is last else renderer(kits, shot.poses, shot.gripper, caption, shot.base))
            last = shot
            progress(len(frames) / len(takes))
    write_film(path, frames, fps)


def final_picture(task: Task, playback: Playback, *, width: int = 960, height: int = 540) -> bytes | None:
    """Return a PNG of the scene at the end of an episode, or None if nothing can be drawn."""
    import imageio.v3 as imageio

    if available() is not True:
        return None
    final = playback.final
    try:
        with Renderer(task, width=width, height=height) as renderer:
            base = None if final.base is None else final.base[0]
            frame = renderer(final.kits[0], final.poses[0], base=base)
    except UserError:
        return None
    buffer = io.BytesIO()
    imageio.imwrite(buffer, frame, extension=".png")
    return buffer.getvalue()
