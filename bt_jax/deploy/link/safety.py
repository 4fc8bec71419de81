"""What may be sent to the arms: the rules, and the checks of a single setpoint and of a whole path before it begins.

A target that breaks a rule is rejected as a whole. What is watched while the robot runs is in `supervision`, and how each
setpoint keeps to the limits of speed and acceleration in `setpoints`. This is software: it replaces neither the emergency
stop nor a risk assessment.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.arrays import JointRows, Joints, Point

__all__ = ["Clearance", "Points", "Rejected", "Rules", "check_setpoint", "check_trajectory", "least_clearance"]

Points = Callable[[str, Joints], Mapping[str, Point]]
"""points(arm, joints) -> {"tcp": xyz, "elbow": xyz, ...} in the robot's base frame [m]."""
Clearance = Callable[[Mapping[str, Joints]], float]
"""clearance({arm: joints}) of all arms -> smallest distance [m] between the arms, and to tables and fixtures."""

SEEN_EVERY = 0.02  # seconds of a trajectory between two looks at clearance
SLACK = 1e-9
NEARER = 0.0005  # m that arms which are too near already may come nearer on their way out: measurements are not exact


class Rejected(Exception):
    """A target that must not be approached; the message says which rule it breaks."""


@dataclasses.dataclass(frozen=True)
class Rules:
    """What is allowed. Joint bounds [rad], speeds [rad/s] and accelerations [rad/s2] are those of the joints in chain order,
    the same for all arms; one acceleration counts for all joints."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    speed: tuple[float, ...]  # of the robot: faster targets are rejected
    acceleration: tuple[float, ...]
    lowest: tuple[float, float, float]  # workspace of the points, base frame [m]
    highest: tuple[float, float, float]
    margin: float = np.radians(2.0)  # distance kept from the joint bounds
    implausible: float = np.radians(5.0)  # beyond the joint bounds: no arm is measured there
    override: float = np.inf  # rad/s: slower than the robot could; trajectories are slowed down to it
    agreement: float = 0.005  # rad between the measurements that make the first setpoint
    moved: float = 0.02  # rad between the first setpoint and where the arm is when it begins to follow
    start: float = 0.005  # rad between where an arm is sent and where a new path begins
    deviation: float = 0.02  # rad by which setpoints may leave a path to keep to the limits
    lag: float = 0.05  # rad between measurement and all that was sent within `response`: something blocks the arm
    response: float = 0.3  # seconds by which an arm may follow late, which explains what it lags behind at any speed
    clearance: float = 0.005  # m
    longest: float = 0.012  # seconds for which one message may move an arm on, however long none came
    stale: float = 0.1  # seconds without feedback
    gap: int = 10  # messages lost in a row
    pause: float = 0.3  # seconds without a sign of life from the executor, until arms pause on their paths
    overrun: float = 1.0  # the same, until moving arms are stopped for good
    idle: float = 5.0  # the same while the arms rest: nothing is urgent, and a first look takes time
    points: Points | None = None
    clearance_of: Callable[[], Clearance] | None = None  # called once in each process that checks

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, float | int | tuple):
                continue
            if np.isnan(value).any():
                raise ValueError(f"the rule '{name}' is not a number, and would allow everything")
            if name not in SIGNED and not np.all(np.array(value) >= 0):
                raise ValueError(f"the rule '{name}' is negative")
            if name != "override" and np.isinf(value).any():
                raise ValueError(f"the rule '{name}' is not finite, and would allow everything")
        if not (np.all(np.array(self.lower) < self.upper) and np.all(np.array(self.lowest) < self.highest)):
            raise ValueError("a lower bound of the rules is not below its upper bound")


SIGNED = {"lower", "upper", "lowest", "highest"}  # rules that may be negative


def bounds(
    rules: Rules, before: Float[np.ndarray, "*rows joints"] | None = None
) -> tuple[Float[np.ndarray, "*rows joints"], Float[np.ndarray, "*rows joints"]]:
    """Return the least and the largest joints that may be sent. An arm that is outside, at `before`, may stay there but not
    go farther outside."""
    lower, upper = np.array(rules.lower) + rules.margin, np.array(rules.upper) - rules.margin
    return (lower, upper) if before is None else (np.minimum(lower, before), np.maximum(upper, before))


def least_clearance(rules: Rules, distance: float) -> float:
    """Return the clearance [m] that must be kept on a path that begins at this `distance` [m]. Arms that begin too near may
    stay as near but not come nearer; NaN, which nothing keeps, where the distance is NaN or -inf."""
    return min(rules.clearance, distance - NEARER) if distance > -np.inf else np.nan


def check_setpoint(rules: Rules, arm: str, joints: Joints, *, before: Joints | None = None) -> None:
    """Raise Rejected if one configuration breaks a rule that needs no other arm; `before` is the setpoint before it."""
    if not np.isfinite(joints).all():
        raise Rejected(f"{arm}: a joint is not a number")
    _check_joints(rules, arm, joints[None], None if before is None else before[None])
    _check_points(rules, arm, joints, before)


def _check_joints(rules: Rules, arm: str, rows: JointRows, before: JointRows | None) -> None:
    """Raise Rejected if a row is out of the bounds of the joints."""
    lower, upper = bounds(rules, before)
    beyond = np.maximum(lower - rows, rows - upper)
    if not beyond.max() <= SLACK:
        row, worst = np.unravel_index(beyond.argmax(), beyond.shape)
        least, most = np.degrees(np.array(rules.lower) + rules.margin), np.degrees(np.array(rules.upper) - rules.margin)
        raise Rejected(
            f"{arm}: joint {worst + 1} of the chain at {np.degrees(rows[row, worst]):.1f} deg is beyond "
            f"{least[worst]:.1f} .. {most[worst]:.1f} deg"
        )


def _check_points(rules: Rules, arm: str, joints: Joints, before: Joints | None) -> None:
    """Raise Rejected if a point of the arm is outside the workspace, and farther than it was before."""
    if rules.points is None:
        return
    for name, point in rules.points(arm, joints).items():
        if (point >= rules.lowest).all() and (point <= rules.highest).all():
            continue
        known = None if before is None else rules.points(arm, before)[name]
        if known is None or not (
            np.all(point >= np.minimum(rules.lowest, known)) and np.all(point <= np.maximum(rules.highest, known))
        ):
            raise Rejected(f"{arm}: {name} at ({', '.join(f'{x:.3f}' for x in point)}) m is outside the workspace")


def check_trajectory(
    rules: Rules,
    arm: str,
    trajectory: Trajectory,
    *,
    commanded: Joints,
    others: Mapping[str, Joints],
    clearance: Clearance | None,
) -> Trajectory:
    """Return the trajectory as it may run, slowed down to `rules.override`.

    `commanded` is where the arm is sent now, `others` where each other arm is. Raise Rejected if any point
    breaks a rule: it is not entered, not even in part.
    """
    if trajectory.joints.shape[1] != len(commanded):
        raise Rejected(f"{arm}: the path is of {trajectory.joints.shape[1]} joints, the arm has {len(commanded)}")
    if not np.all(np.isfinite(trajectory.joints)) or not np.all(np.isfinite(trajectory.times)):
        raise Rejected(f"{arm}: a joint is not a number")
    away = float(np.max(np.abs(trajectory.joints[0] - commanded)))
    if not away <= rules.start:
        raise Rejected(f"{arm}: the path begins {np.degrees(away):.1f} deg away from where the arm is")
    speeds = np.abs(trajectory.speeds())
    if not np.all(speeds <= np.array(rules.speed) * (1 + 1e-6)):
        worst = int(np.argmax((speeds / rules.speed).max(axis=0)))
        raise Rejected(f"{arm}: joint {worst + 1} of the chain would turn at {speeds[:, worst].max():.2f} rad/s")
    factor = max(1.0, float(speeds.max(initial=0.0)) / rules.override)
    allowed = trajectory.slowed(factor)
    _check_acceleration(rules, arm, allowed)
    rows = trajectory.joints
    before = np.concatenate([commanded[None], rows[:-1]])
    _check_joints(rules, arm, rows, before)
    for joints, last in zip(rows, before, strict=True):
        _check_points(rules, arm, joints, last)
    if clearance is not None:
        least = least_clearance(rules, clearance({**others, arm: commanded}))
        for time in np.append(np.arange(SEEN_EVERY, trajectory.duration, SEEN_EVERY), trajectory.duration):
            distance = clearance({**others, arm: trajectory.at(time)})
            if not distance >= least:
                raise Rejected(f"{arm}: the path comes as near as {1000 * distance:.0f} mm, {time:.2f} s on its way")
    return allowed


def _check_acceleration(rules: Rules, arm: str, trajectory: Trajectory) -> None:
    """Raise Rejected if speeds change too much, from rest to rest, in a cycle or between points that are nearer."""
    gaps = np.diff(trajectory.times)
    if len(gaps) == 0:
        return
    rest = np.zeros((1, trajectory.joints.shape[1]))
    changes = np.abs(np.diff(np.concatenate([rest, trajectory.speeds(), rest]), axis=0))
    between = np.concatenate([gaps[:1], (gaps[1:] + gaps[:-1]) / 2, gaps[-1:]])
    found = changes / np.minimum(between, CYCLE)[:, None]
    if not np.all(found <= np.array(rules.acceleration) * (1 + 1e-6)):
        worst = int(np.argmax((found / rules.acceleration).max(axis=0)))
        raise Rejected(
            f"{arm}: joint {worst + 1} of the chain would be accelerated by {found[:, worst].max():.0f} rad/s2"
        )
