"""Timing of paths: TOPP-RA beside what was used before it and what is quickly written, on the same paths at the same limits.

    python -m benchmarks.deploy_timing [--layouts 40]

The paths are those that are planned for a pick and for the put after it in random layouts, free ones and straight ones.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tyro
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.spatial.transform import RigidTransform

from benchmarks._report import report
from bt_jax.deploy.execution.settings import MotionSettings
from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.grasps import carried_pose
from bt_jax.deploy.planning.paths import densified
from bt_jax.deploy.planning.planner import JointPath, Planner, Surroundings
from bt_jax.deploy.planning.timing import PERIOD, ROUND, Pace, timed
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.arrays import JointRows
from bt_jax.deploy.robot.model import ArmModel
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import box_poses, build_scene
from bt_jax.tasks import load_task

CORNER = np.cos(np.radians(20))  # of the turn at a corner, in joint space
SAMPLES = 150  # of a piece of a quintic

Timing = Callable[[JointRows, Pace, ArmModel], Trajectory]


@dataclasses.dataclass(frozen=True)
class Arguments:
    layouts: int = 40
    """random layouts in which a pick and a put are planned"""
    out: Path | None = None
    """where to write the JSON file"""


def averaged(path: JointRows, pace: Pace, arm: ArmModel) -> Trajectory:
    """Return what was used before TOPP-RA: the highest speed of each piece, then two moving averages over time, as long as
    the highest speed of all asks for; corners are cut by what is travelled in half of that."""
    path = densified(path)
    steps = np.diff(path, axis=0)
    seconds = np.maximum((np.abs(steps) / (pace.share * arm.speed)).max(axis=1), _ways(path, arm) / pace.tool)
    speed = np.abs(steps / seconds[:, None]).max()
    window = max(2, round(2 * speed / (pace.acceleration * arm.acceleration.min()) / PERIOD))
    times = np.concatenate([[0], np.cumsum(seconds)])
    grid = np.arange(0, times[-1] + PERIOD, PERIOD)
    rows = np.stack([np.interp(grid, times, column) for column in path.T], axis=1)
    for width in (window, max(2, window // 2)):
        padded = np.pad(rows, ((width - 1, width - 1), (0, 0)), mode="edge")
        rows = np.stack([np.convolve(column, np.full(width, 1 / width), "valid") for column in padded.T], axis=1)
    rows[0], rows[-1] = path[0], path[-1]
    fastest = _ways(rows, arm).max() / PERIOD
    return Trajectory(PERIOD * np.arange(len(rows)), rows).slowed(max(1.0, fastest / pace.tool))


def quintic(path: JointRows, pace: Pace, arm: ArmModel) -> Trajectory:
    """Return the path with a polynomial of fifth order in time along it, from rest to rest, as fast as it may; the arm stops
    at corners, and the points of a straight path are joined by a spline."""
    ways = np.diff(path, axis=0) / np.linalg.norm(np.diff(path, axis=0), axis=1, keepdims=True)
    corners = 1 + np.flatnonzero((ways[1:] * ways[:-1]).sum(axis=1) < CORNER)
    times, rows = [np.array([0.0])], [path[:1]]
    for first, last in zip([0, *corners], [*corners, len(path) - 1], strict=True):
        points = path[first : last + 1]
        lengths = np.cumsum([0, *np.linalg.norm(np.diff(points, axis=0), axis=1)])
        curve = CubicSpline(lengths, points) if len(points) > 2 else make_interp_spline(lengths, points, k=1)
        s = np.linspace(0, 1, SAMPLES + 1)
        joints = curve(lengths[-1] * (10 * s**3 - 15 * s**4 + 6 * s**5))
        speeds = np.diff(joints, axis=0) * SAMPLES  # rad for the whole piece
        changes = np.diff(np.pad(speeds, ((1, 1), (0, 0))), axis=0) * SAMPLES
        seconds = max(
            (np.abs(speeds) / (pace.share * arm.speed)).max(),
            np.sqrt((np.abs(changes) / (pace.acceleration * arm.acceleration)).max()),
            _ways(joints, arm).max() * SAMPLES / pace.tool,
        )
        times.append(times[-1][-1] + s[1:] * seconds)
        rows.append(joints[1:])
    return Trajectory(np.concatenate(times), np.concatenate(rows))


def _ways(rows: JointRows, arm: ArmModel) -> np.ndarray:
    tips = np.array([arm.link_poses(joints)[-1, :3, 3] for joints in rows])
    return np.linalg.norm(np.diff(tips, axis=0), axis=1)


METHODS: dict[str, Timing] = {"TOPP-RA": timed, "two moving averages": averaged, "quintic": quintic}


def planned(layouts: int) -> tuple[Planner, list[JointPath], list[tuple[str, JointRows]]]:
    """Return the planner, and the free and the straight paths of a pick and of the put on the next box's top."""
    task = load_task("yumi_stack")
    planner, free, straight = Planner(YUMI, task), [], []
    for seed in range(layouts):
        scene = build_scene(YUMI, task, [7, seed])
        base = RigidTransform.from_translation(task.robot_position).inv()
        poses = {name: base * pose for name, pose in (box_poses(scene, scene.cell.qpos) | dict(scene.kits)).items()}
        box, other = (task.object_names[(seed + k) % len(task.objects)] for k in (0, 1))
        top = poses[other].translation + np.array([0, 0, task.objects[0].edge])
        try:
            reach = planner.pick(box, Surroundings(poses, YUMI.home), YUMI.arm_names)
            free.append(reach.approach)
            straight.append((reach.arm, reach.line))
            carried = Carried(reach.arm, box, carried_pose(reach.tcp, poses[box], task.thing(box)))
            among = Surroundings(
                {name: pose for name, pose in poses.items() if name != box},
                {**YUMI.home, reach.arm: reach.line[0]},
                carried,
            )
            reach = planner.put(carried, top, 0.0, among)
            free.append(reach.approach)
            straight.append((reach.arm, reach.line))
        except Unplannable:
            continue
    return planner, free, straight


def corner(path: JointPath, ran: Trajectory, pace: Pace) -> str:
    """Return how the planner lets an arm pass the corners of a path."""
    for how, before in (("rounded", ROUND), ("rounded closely", ROUND / 4)):
        if ran.duration == timed(path.rows, pace, YUMI.arm(path.arm), round_from=before).duration:
            return how
    return "stops"


def row(kind: str, name: str, method: Timing, paths: list[tuple[str, JointRows]], pace: Pace) -> dict:
    """Return means over paths, and of the highest share of the permitted acceleration on each also the largest."""
    seconds, work, shares, jerks = [], [], [], []
    for side, rows in paths:
        arm = YUMI.arm(side)
        start = time.process_time()
        ran = method(rows, pace, arm)
        work.append(time.process_time() - start)
        seconds.append(ran.duration)
        gaps = np.diff(ran.times)[:, None]
        between = (np.concatenate([gaps[:1], gaps]) + np.concatenate([gaps, gaps[-1:]])) / 2
        changes = np.diff(np.pad(ran.speeds(), ((1, 1), (0, 0))), axis=0) / between
        shares.append(float((np.abs(changes) / (pace.acceleration * arm.acceleration)).max()))
        jerks.append(float((np.abs(np.diff(changes, axis=0)) / gaps).max()))
    return {
        "paths": kind,
        "method": name,
        "count": len(paths),
        "mean_s": float(np.mean(seconds)),
        "longest_s": max(seconds),
        "mean_ms": float(np.mean(work)) * 1000,
        "share_of_acceleration": float(np.mean(shares)),
        "most_share": max(shares),
        "largest_jerk": max(jerks),
    }


def main(arguments: Arguments) -> None:
    pace = Pace()
    planner, free, straight = planned(arguments.layouts)
    bent = [path for path in free if len(path.rows) > 2]
    groups = (
        ("free, no corner", [(path.arm, path.rows) for path in free if len(path.rows) == 2], pace),
        ("free, with corners", [(path.arm, path.rows) for path in bent], pace),
        ("straight", straight, pace),
        ("straight, as slow as an arm runs it", straight, pace.slowed(MotionSettings().straight)),
    )
    rows = [
        row(kind, name, method, paths, its_pace)
        for kind, paths, its_pace in groups
        if paths
        for name, method in METHODS.items()
    ]
    how = [corner(path, planner.timed(path, pace), pace) for path in bent]
    corners = {
        "paths": len(bent),
        "corners": sum(len(path.rows) - 2 for path in bent),
        **{name: how.count(name) for name in ("rounded", "rounded closely", "stops")},
    }
    report("deploy_timing", "motions", rows, out=arguments.out, layouts=arguments.layouts, planned=corners)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
