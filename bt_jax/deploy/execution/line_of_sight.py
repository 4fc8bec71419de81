"""Is an arm between the camera and what it should see?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

__all__ = ["in_the_way"]

RADIUS = 0.1  # m around the line through an arm's links within which it may hide something, with what it carries

Points = Float[np.ndarray, "n 3"]


def in_the_way(arm: Points, sight: Sequence[Sequence[float]]) -> bool:
    """May an arm, given by the origins of its links in chain order, hide one of the places of `sight` from the first of
    them, the camera's? All in one frame, m."""
    eye, places = np.array(sight[0], float), np.array(sight[1:], float)
    starts, ends = (arm[:-1], arm[1:]) if len(arm) > 1 else (arm, arm)
    return any(_distance(eye, place, starts, ends).min() < RADIUS for place in places)


def _distance(
    a: Float[np.ndarray, " 3"], b: Float[np.ndarray, " 3"], starts: Points, ends: Points
) -> Float[np.ndarray, " n"]:
    """Return the distance of the line segment from `a` to `b` from each of others (Ericson, Real-Time Collision Detection,
    5.1.9)."""
    u, v, w = b - a, ends - starts, a - starts
    uu, vv, uv = u @ u, np.einsum("nk,nk->n", v, v), v @ u
    uw, vw = w @ u, np.einsum("nk,nk->n", v, w)
    flat = np.maximum(uu * vv - uv**2, 1e-12)
    s = np.clip((uv * vw - uw * vv) / flat, 0, 1)
    t = np.clip((s * uv + vw) / np.maximum(vv, 1e-12), 0, 1)
    s = np.clip((t * uv - uw) / max(uu, 1e-12), 0, 1)
    return np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
