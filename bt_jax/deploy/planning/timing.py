"""When an arm is where on a path: as fast as the limits of its joints and of its tool permit, from rest to rest.

The corners of a path are rounded with parabolas, and TOPP-RA (Pham and Pham 2018, "A new approach to time-optimal path
parameterization based on reachability analysis") finds the fastest way to run along it. A moving average over time then
bounds the jerk: it leaves speeds and accelerations within their bounds, and straight paths straight.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PPoly
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint, LinearConstraint
from toppra.interpolator import AbstractGeometricPath

from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.arrays import JointRows
from bt_jax.deploy.robot.model import ArmModel

__all__ = ["ROUND", "Pace", "timed"]

PERIOD = 0.008  # seconds between the points of a trajectory
GRID = 80  # points of a path at which speeds are chosen, besides the ends of its pieces
SMOOTH = 10  # points of a trajectory that are averaged
SAME = 1e-6  # rad: points that are nearer are one
ROUND = 0.2  # rad before a corner where it begins to be rounded
logging.getLogger("toppra").setLevel(logging.ERROR)

Numbers = Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class Pace:
    """How fast an arm moves: shares of its joints' limits of speed and acceleration, speed of the tool [m/s]."""

    share: float = 0.45
    acceleration: float = 0.3
    tool: float = 0.5

    def slowed(self, factor: float) -> Pace:
        """Return the pace with all speeds `factor` times as high; accelerations follow."""
        return Pace(self.share * factor, self.acceleration * factor, self.tool * factor)


def timed(path: JointRows, pace: Pace, arm: ArmModel, *, round_from: float = ROUND) -> Trajectory:
    """Return a path as a trajectory that starts and ends at rest and keeps the pace at every point. Its corners are rounded
    from `round_from` before them [rad along the path], or from half of the way to the next; with 0 the arm stops there.

    Raise Unplannable if no way to run along it is found.
    """
    path = _distinct(np.asarray(path, float))
    if len(path) == 1:
        return Trajectory(np.array([0.0]), path)
    if round_from <= 0 and len(path) > 2:
        return _joined([timed(path[i : i + 2], pace, arm) for i in range(len(path) - 1)])
    rows = _averaged(_fastest(_Path(_rounded(path, round_from)), pace, arm))
    rows[0], rows[-1] = path[0], path[-1]
    return _within(Trajectory(PERIOD * np.arange(len(rows)), rows), pace, arm)


def _distinct(path: JointRows) -> Float[np.ndarray, "m joints"]:
    """Return the path without points that are where another one is, but with both ends, unless they are all it has."""
    points = [path[0]]
    for point in path[1:-1]:
        if min(np.abs(point - points[-1]).max(), np.abs(point - path[-1]).max()) > SAME:
            points.append(point)
    if np.abs(path[-1] - points[-1]).max() > SAME:
        points.append(path[-1])
    return np.array(points)


def _rounded(path: JointRows, before: float) -> PPoly:
    """Return the path as a function of the length along it, each corner replaced by a parabola that begins at most `before`
    ahead of it."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    ways = np.diff(path, axis=0) / lengths[:, None]
    cut = np.array(
        [0.0, *np.minimum(before, np.minimum(lengths[:-1], lengths[1:]) / 2), 0.0]
    )  # at both ends of each piece
    pieces, ends = [], [0.0]
    for i, (way, length) in enumerate(zip(ways, lengths, strict=True)):
        straight = length - cut[i] - cut[i + 1]
        if straight > 1e-9:
            pieces.append((np.zeros_like(way), way, path[i] + cut[i] * way))
            ends.append(ends[-1] + straight)
        if i + 1 < len(lengths):
            pieces.append(((ways[i + 1] - way) / (4 * cut[i + 1]), way, path[i + 1] - cut[i + 1] * way))
            ends.append(ends[-1] + 2 * cut[i + 1])
    return PPoly(np.stack(pieces, axis=1), np.array(ends))


def _fastest(path: _Path, pace: Pace, arm: ArmModel) -> Float[np.ndarray, "m joints"]:
    """Return where the joints are every `PERIOD`, as fast as the pace permits."""
    ends = path.curve.x
    counts = np.maximum(2, np.ceil(np.diff(ends) / ends[-1] * GRID).astype(int)) + 1
    grid = np.unique(np.concatenate([np.linspace(*piece) for piece in zip(ends, ends[1:], counts, strict=False)]))
    limits = [
        JointVelocityConstraint(pace.share * arm.speed),
        JointAccelerationConstraint(pace.acceleration * arm.acceleration),
        _ToolSpeed(arm, pace.tool),
    ]
    _, speeds, _ = TOPPRA(limits, path, gridpoints=grid, solver_wrapper="seidel").compute_parameterization(0, 0)
    if speeds is None:
        raise Unplannable("TOPP-RA finds no way to run along a path from rest to rest")
    gaps = 2 * np.diff(grid) / (speeds[1:] + speeds[:-1])
    times = np.concatenate([[0], np.cumsum(gaps)])
    now = np.append(np.arange(0, times[-1], PERIOD), times[-1])
    i = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(gaps) - 1)
    since = now - times[i]
    return path(grid[i] + speeds[i] * since + np.diff(speeds)[i] / gaps[i] * since**2 / 2)


def _averaged(rows: JointRows) -> Float[np.ndarray, "m joints"]:
    """Return the moving average of rows that rest at both ends before and after; `SMOOTH` - 1 rows longer."""
    padded = np.pad(rows, ((SMOOTH - 1, SMOOTH - 1), (0, 0)), mode="edge")
    sums = np.cumsum(np.concatenate([np.zeros_like(rows[:1]), padded]), axis=0)
    return (sums[SMOOTH:] - sums[:-SMOOTH]) / SMOOTH


def _within(trajectory: Trajectory, pace: Pace, arm: ArmModel) -> Trajectory:
    """Return the trajectory, slower where it breaks a limit between the points where speeds were chosen."""
    speeds, rest = trajectory.speeds(), np.zeros_like(trajectory.joints[:1])
    changes = np.diff(np.concatenate([rest, speeds, rest]), axis=0) / PERIOD
    tips = np.array([arm.link_poses(joints)[-1, :3, 3] for joints in trajectory.joints])
    excess = (
        (np.abs(speeds) / (pace.share * arm.speed)).max(),
        np.sqrt((np.abs(changes) / (pace.acceleration * arm.acceleration)).max()),
        np.linalg.norm(np.diff(tips, axis=0), axis=1).max() / PERIOD / pace.tool,
    )
    return trajectory.slowed(max(1.0, *map(float, excess)))


def _joined(pieces: list[Trajectory]) -> Trajectory:
    """Return one trajectory after the other."""
    times, rows, end = [np.array([0.0])], [pieces[0].joints[:1]], 0.0
    for piece in pieces:
        times.append(piece.times[1:] + end)
        rows.append(piece.joints[1:])
        end += piece.duration
    return Trajectory(np.concatenate(times), np.concatenate(rows))


class _Path(AbstractGeometricPath):
    """A curve as TOPP-RA asks for it."""

    def __init__(self, curve: PPoly) -> None:
        self.curve = curve
        self._orders = (curve, curve.derivative(1), curve.derivative(2))

    def __call__(self, length: Numbers, order: int = 0) -> Float[np.ndarray, "n joints"]:
        return self._orders[order](length)

    @property
    def dof(self) -> int:
        return self.curve.c.shape[2]

    @property
    def path_interval(self) -> Numbers:
        return self.curve.x[[0, -1]]

    @property
    def waypoints(self) -> tuple[Numbers, JointRows]:
        return self.curve.x, self.curve(self.curve.x)


class _ToolSpeed(LinearConstraint):
    """The speed of the tool [m/s], by the way that it moves between the points of the grid."""

    def __init__(self, arm: ArmModel, limit: float) -> None:
        super().__init__()
        self.dof, self._arm, self._limit = len(arm.joints), arm, limit

    def compute_constraint_params(self, path: _Path, grid: Numbers) -> tuple[Float[np.ndarray, "n 2"] | None, ...]:
        """Return the bounds of the squared speed along the path."""
        tips = np.array([self._arm.link_poses(joints)[-1, :3, 3] for joints in path(grid)])
        ways = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(
            grid
        )  # m of the tool for each rad along the path
        most = np.maximum(np.append(ways, 0), np.insert(ways, 0, 0))
        fastest = np.minimum((self._limit / np.maximum(most, 1e-9)) ** 2, 1e8)
        return None, None, None, None, None, None, np.stack([np.zeros_like(fastest), fastest], axis=1)
