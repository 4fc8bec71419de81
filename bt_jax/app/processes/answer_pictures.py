"""A picture of what each answer to a question does."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import imageio.v3 as imageio
import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.lfd import Question
from bt_jax.mjx_env.render.offscreen import Renderer
from bt_jax.tasks import Task

__all__ = ["answer_pictures"]

WIDTH, HEIGHT = 320, 180  # pixels


def answer_pictures(questions: Sequence[Question], task: Task) -> tuple[tuple[str, ...], ...]:
    """Return the addresses of a picture for each answer to each question, which hold all of it; none if nothing can draw
    here."""
    if not questions:
        return ()
    try:
        with Renderer(task, width=WIDTH, height=HEIGHT) as draw:
            return tuple(
                tuple(
                    _address(draw(answer.shows.kits[0], answer.shows.poses[0], base=_base(answer.shows.base)))
                    for answer in one.answers
                )
                for one in questions
            )
    except UserError:
        return tuple(() for _ in questions)


def _base(base: np.ndarray | None) -> np.ndarray | None:
    return None if base is None else base[0]


def _address(picture: np.ndarray) -> str:
    png = imageio.imwrite("<bytes>", picture, extension=".png")
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"
