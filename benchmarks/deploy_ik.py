"""Inverse kinematics: how many of 1,000 reachable poses an arm solves and how long that takes; and whether paths that were
planned are free in MuJoCo too.

    python -m benchmarks.deploy_ik [--poses 1000] [--plans 50]
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import mujoco
import numpy as np
import tyro
from scipy.spatial.transform import RigidTransform

from benchmarks._report import report
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.planning.planner import Planner, Surroundings
from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import TwinScene, box_poses, build_scene
from bt_jax.tasks import load_task


@dataclasses.dataclass(frozen=True)
class Arguments:
    poses: int = 1000
    """random reachable poses of each arm"""
    plans: int = 50
    """random layouts in which a way to a box is planned"""
    out: Path | None = None
    """where to write the JSON file"""


def solve(arm: str, count: int) -> dict:
    """Random joints give poses that are reachable for certain; each is solved from the place of rest."""
    kinematics, rng = ArmKinematics(YUMI, arm), np.random.default_rng(0)
    solved, exact, seconds = 0, 0.0, []
    for seed in range(count):
        target = YUMI.forward(arm, rng.uniform(kinematics.lower, kinematics.upper))
        start = time.perf_counter()
        found = kinematics.solve(target, YUMI.home[arm], seed=seed)
        seconds.append(time.perf_counter() - start)
        if found is not None:
            solved += 1
            exact = max(exact, float(np.abs(YUMI.forward(arm, found).as_matrix() - target.as_matrix()).max()))
    median, slow = np.percentile(seconds, [50, 99]) * 1000
    return {
        "arm": arm,
        "poses": count,
        "solved": solved,
        "median_ms": float(median),
        "p99_ms": float(slow),
        "worst_error": exact,
    }


def contacts(scene: TwinScene, arm: str, joints: np.ndarray, box: str) -> int:
    """Contacts of an arm with anything but the box that it grasps, in MuJoCo, along joints [n, 7]."""
    model, data, found = scene.model, mujoco.MjData(scene.model), 0
    ids = [model.joint(name).qposadr[0] for name in YUMI.arm(arm).joint_names]
    for row in joints:
        data.qpos[:] = scene.cell.qpos
        data.qpos[ids] = row
        mujoco.mj_forward(model, data)
        for k in range(data.ncon):
            names = [model.body(model.geom_bodyid[geom]).name for geom in data.contact[k].geom]
            if any(name.startswith(YUMI.arm_names) for name in names) and box not in names:
                found += 1
    return found


def plan(count: int) -> dict:
    """Ways to a random box in random layouts, replayed in MuJoCo."""
    task, planned, colliding, seconds = load_task("yumi_stack"), 0, 0, []
    planner = Planner(YUMI, task)
    for seed in range(count):
        scene = build_scene(YUMI, task, [7, seed])
        poses = box_poses(scene, scene.cell.qpos) | dict(scene.kits)
        base = RigidTransform.from_translation(task.robot_position).inv()
        poses = {name: base * pose for name, pose in poses.items()}
        box = task.object_names[seed % len(task.objects)]
        start = time.perf_counter()
        try:
            reach = planner.pick(box, Surroundings(poses, YUMI.home), YUMI.arm_names)
        except Unplannable:
            continue
        finally:
            seconds.append(time.perf_counter() - start)
        planned += 1
        ways = planner.timed(reach.approach, Pace()), timed(reach.line, Pace(), YUMI.arm(reach.arm))
        colliding += any(contacts(scene, reach.arm, way.joints[::2], box) for way in ways)
    median, slow = np.percentile(seconds, [50, 99])
    return {
        "layouts": count,
        "planned": planned,
        "colliding": colliding,
        "median_s": float(median),
        "p99_s": float(slow),
    }


def main(arguments: Arguments) -> None:
    rows = [solve(arm, arguments.poses) for arm in YUMI.arm_names]
    report("deploy_ik", "inverse kinematics of one arm", rows, out=arguments.out, plans=plan(arguments.plans))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
