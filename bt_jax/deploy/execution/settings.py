"""The numbers of execution, each in one place: time limits of a run, grasping, motion, calibration, and exit codes."""

from __future__ import annotations

import dataclasses

__all__ = ["SIMULATED_TICK", "TWIN_SECONDS", "CalibrationLimits", "Exit", "GraspSettings", "Limits", "MotionSettings"]

TWIN_SECONDS = 240.0  # for a run on the twin
SIMULATED_TICK = 6.0  # s that a tick of the simulation stands for: six attempts take the twin 36 s


class Exit:
    """Exit codes of the commands."""

    DONE, FAILED, USER_ERROR, STOPPED, INTERRUPTED = 0, 1, 2, 3, 130


@dataclasses.dataclass(frozen=True)
class Limits:
    """Times of a run, in seconds, and one count."""

    tick: float = 0.1  # from tick to tick
    run: float = 600.0  # the whole run
    action: float = 60.0  # one attempt, at the twin's speed
    look: float = 3.0  # for what is not seen to be seen once the arms are out of the way; then it counts as absent
    settle: float = 0.5  # for the camera to see what an attempt has changed
    rest: float = 0.35  # for arms that were told to stop to come to rest
    patience: float = (
        10.0  # for which the tree may fail before the run has failed; half where an action was tried too often
    )
    unseen: float = 10.0  # for which what is missing may not be seen; the tree may then fail for half its patience
    finding: float = 2.0  # for which a finding may last that makes what is known wrong
    covered: float = 10.0  # the same for something that hides a marker: it may be a person's hand
    success: float = 1.0  # for which it must succeed
    image: float = 1.0  # the newest image may be old
    broken_off: int = 5  # times that an attempt at an action is broken off, with nothing new achieved meanwhile


@dataclasses.dataclass(frozen=True)
class CalibrationLimits:
    """How well the camera must be known."""

    reprojection: float = 1.0  # px, root mean square, of the lens
    focal: float = 0.01  # standard deviation of its focal lengths, as a share of them
    centre: float = 0.01  # and of its centre, as a share of the image's width
    turned: float = 15.0  # degrees between two of the views at least
    residual: float = 0.005  # m, root mean square, of the camera's place


@dataclasses.dataclass(frozen=True)
class GraspSettings:
    """How fingers grasp a box, and how it is known that they hold it."""

    squeeze: float = 0.003  # m: fingers that grasp are sent at least this much closer together than the box is wide
    overclose: float = 0.012  # m: by how much closer they are sent
    force: float = 15.0  # N
    fit: float = 0.006  # m by which the fingers' distance may differ from the box's size
    steady: float = 0.001  # m that the fingers may still move between two observations
    near: float = 0.02  # m that a held box's centre may be off the hand's, besides half its size
    before: float = (
        0.05  # m beside an arm within which it may hide a marker that something unknown would be said to hide
    )
    beside: float = (
        0.01  # m beside an arm within which it may hide what would be said to be missing: to look costs little
    )
    trail: float = 1.2  # s by which a pose may lag behind the hand
    still: float = 0.0005  # m that resting fingers move within `rest`
    rest: float = 0.3  # s without motion after which fingers rest; readings come more often
    reaction: float = 1.5  # s within which a command to the fingers shows in their readings, over Robot Web Services
    patience: float = 6.0  # s for fingers to come to rest
    nothing: float = 0.003  # m from where they were sent, within which closing fingers have met nothing
    let_go: float = 0.0007  # m above its place at which a box is released


@dataclasses.dataclass(frozen=True)
class MotionSettings:
    """How arms move between grasps."""

    replans: int = 3  # times that an attempt plans again where things have moved
    spots: int = 25  # places tried for setting a box down
    arrived: float = 0.01  # rad from the end of a path, as sent and as measured
    settle: float = 1.0  # s after its last setpoint within which an arm must have come there
    at_home: float = 0.05  # rad from the place of rest
    shifted: float = 0.006  # m by which what is aimed at must have moved for a new plan
    aside: float = 0.015  # m by which what is to be avoided must have moved for a new plan
    turned: float = 0.1  # rad by which either must have turned
    straight: float = 0.3  # share of the pace on the straight path down
    sight: float = Limits.look  # s for something to show once the arms are out of the way
