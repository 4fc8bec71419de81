"""A robot that drives: its base, and how far the arm on it reaches."""

from __future__ import annotations

import dataclasses

from bt_jax.tasks.things import Vec2

__all__ = ["STANDING", "Base", "Robot"]


@dataclasses.dataclass(frozen=True)
class Base:
    """A base that drives on the floor: seen from above a disc of `radius`, which moves up to `step` metres in a tick. It
    starts under `robot_position`; the arm reaches `reach` metres far from the point at that height over the base's middle.
    `stations` are x and y of its standing places in the world; where none are given, they are computed
    (`stations.standing_places`)."""

    reach: float
    radius: float = 0.25
    step: float = 1.0
    stations: tuple[Vec2, ...] = ()


@dataclasses.dataclass(frozen=True)
class Robot:
    """What the robot is: without a base it stands where it is, and reaches everything that is not on the floor."""

    base: Base | None = None


STANDING = Robot()
