"""The solids that stand for YuMi's links: fitted to the surface of public meshes, and measured.

    python -m benchmarks.collision_shapes SURFACE.json [--fit]

SURFACE.json has points on the surface, in metres, in the frames of "body", "link_1" to "link_7" (joints in chain order),
"hand" and "finger". `--fit` writes the hulls of every link, and which pairs of links need no look, to the table that the
model of YuMi is made from. Without it the model is measured: how far points of the surface are outside of the solids, how
far the solids reach beyond the surface, how many poses above the tables an arm reaches, and how long it takes to ask for the
clearance.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import coal
import numpy as np
import tyro
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks._hulls import Points, beyond, cut, filled, fitted, halved, outside
from benchmarks._report import best_seconds, report, show
from bt_jax.deploy.planning.clearance import CellClearance, SafetyClearance
from bt_jax.deploy.planning.grasps import grasp_poses
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.planning.planner import Planner, Surroundings
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.shapes import Box, Capsule, Hull, Link, LinkShape, placement_matrix
from bt_jax.deploy.robot.yumi import SHAPES_FILE, YUMI
from bt_jax.deploy.twin.cell import box_poses, build_scene
from bt_jax.tasks import Task, load_task

LINKS = ("body", *(f"link_{i}" for i in range(1, 8)), "hand", "finger_a", "finger_b")
GAP = {"body": 0.06}  # m between points of a surface that are neighbours
OTHER_GAP = 0.012
CORNERS = {"body": 36}
OTHER_CORNERS = 22
BENT = ("link_1", "link_2", "link_3", "link_4", "link_5")  # of two parts
BODY: tuple[
    tuple[tuple[tuple[float, ...], tuple[float, ...]], ...], ...
] = (  # of five: in which boxes their points are
    (((-1, -1, 0.28), (1, 1, 1)),),
    (((-1, -0.125, 0.1), (-0.105, 0.125, 0.285)),),
    (((-1, 0.09, -0.016), (1, 1, 0.12)),),
    (((-1, -1, -0.016), (1, -0.09, 0.12)),),
    (((-1, -1, -1), (0.005, 1, 0.015)), ((-1, -0.1, -1), (0.005, 0.1, 0.12))),
)
PAD = 0.0006  # m that the pad of a finger stands out
CONFIGURATIONS = 10_000
NEVER = 0.02  # m that links are always apart which need no look
ALWAYS = 0.01  # m that links are nearly always apart at most which the joints' limits keep from meeting


@dataclasses.dataclass(frozen=True)
class Arguments:
    surface: tyro.conf.Positional[Path]
    fit: bool = False
    """fit again and write the table of the model, instead of measuring it"""
    poses: int = 500
    """of each kind, for which joints are looked for"""
    layouts: int = 40
    """of the twin, in which a way to a box is looked for"""
    out: Path | None = None
    """where to write the JSON file"""


def hulls_of(name: str, points: Points) -> list[Points]:
    """Return the corners of the hulls that stand for a link."""
    gap = GAP.get(name, OTHER_GAP)
    if name == "body":
        inside = [[((points >= low) & (points <= high)).all(axis=1) for low, high in boxes] for boxes in BODY]
        parts: Sequence[Points] = [points[np.any(masks, axis=0)] for masks in inside]
    elif name in BENT:
        parts = halved(points, gap)
    elif name == "finger":
        parts = cut(points, np.array([1.0, 0, 0]), -PAD, gap)[:1]
    else:
        parts = [points]
    hulls = [fitted(part, CORNERS.get(name, OTHER_CORNERS)) for part in parts]
    return [np.minimum(hull, [-PAD, 1, 1]) for hull in hulls] if name == "finger" else hulls


def distances(hulls: Mapping[str, Sequence[Points]]) -> dict[tuple[str, str], np.ndarray]:
    """Return how far the links of one arm, neighbours left out, and the body are from each other, in random
    configurations."""
    solids = {name: [_convex(hull) for hull in of_link] for name, of_link in hulls.items()}
    chain = {"body": 0} | {f"link_{i}": i for i in range(1, 8)} | {"hand": 7, "finger_a": 8, "finger_b": 8}
    pairs = [pair for pair in itertools.combinations(LINKS, 2) if abs(chain[pair[0]] - chain[pair[1]]) > 1]
    rng, found = np.random.default_rng(0), {pair: [] for pair in pairs}
    for k in range(CONFIGURATIONS):
        frames = dict(_frames(YUMI.arm_names[k % 2], rng))
        for a, b in pairs:
            least = min(
                coal.distance(first, frames[a], second, frames[b], coal.DistanceRequest(), coal.DistanceResult())
                for first in solids[a.split("_")[0] if "finger" in a else a]
                for second in solids["finger" if "finger" in b else b]
            )
            found[a, b].append(least)
    return {pair: np.array(values) for pair, values in found.items()}


def _frames(name: str, rng: np.random.Generator) -> Iterator[tuple[str, coal.Transform3s]]:
    arm = YUMI.arm(name)
    poses = arm.link_poses(rng.uniform(arm.lower, arm.upper))
    hand, finger = poses[-2] @ placement_matrix(arm.hand), rng.uniform(0, arm.gripper.stroke)
    slid = placement_matrix(((-finger, 0, 0), (0, 0, 0)))
    fingers = [hand @ placement_matrix(placement) @ slid for placement in arm.gripper.fingers]
    for link, pose in zip(LINKS, [np.eye(4), *poses[:-1], hand, *fingers], strict=True):
        yield link, coal.Transform3s(pose[:3, :3], pose[:3, 3])


def _convex(hull: Points) -> coal.ShapeBase:
    corners = coal.StdVec_Vec3s()
    corners.extend(list(hull))
    return coal.Convex.convexHull(corners, True, "Qt")


def fit(surface: Mapping[str, Points]) -> None:
    """Write the table of the model."""
    hulls = {name: [hull.round(4) for hull in hulls_of(name, points)] for name, points in surface.items()}
    found = distances(hulls)
    never = [pair for pair, values in found.items() if values.min() > NEVER]
    always = [pair for pair, values in found.items() if np.mean(values < ALWAYS) > 0.98]
    lines = []
    for name, of_link in hulls.items():
        rows = ",\n   ".join(json.dumps(hull.tolist(), separators=(",", ":")) for hull in of_link)
        lines.append(f'  "{name}": [\n   {rows}]')
    text = '{\n "hulls": {\n' + ",\n".join(lines) + "\n },\n"
    text += f' "never": {json.dumps(never)},\n "always": {json.dumps(always)}\n}}\n'
    SHAPES_FILE.write_text(text, encoding="utf-8")


def covering(surface: Mapping[str, Points]) -> Iterator[dict]:
    """How well the hulls of each link cover its surface. The pads of the fingers are left out."""
    for name, points in surface.items():
        hulls = shapes_of(name)
        away = outside(points, hulls)
        yield {
            "link": name,
            "hulls": len(hulls),
            "corners": sum(map(len, hulls)),
            "outside_mm": 1000 * float(away.max()),
            "beyond_mm": 1000 * float(beyond(hulls, filled(points, GAP.get(name, OTHER_GAP))).max()),
        }


def shapes_of(name: str) -> list[Points]:
    """Return the hulls of a link in the model."""
    link: Link = int(name[5:]) if name.startswith("link_") else {"body": 0, "finger": "finger_a"}.get(name, name)
    shapes = YUMI.shapes if link == 0 else YUMI.arms[0].shapes
    return [np.array(shape.solid.corners) for shape in shapes if shape.link == link and isinstance(shape.solid, Hull)]


def former() -> RobotModel:
    """Return YuMi with the capsules and boxes that it had before, and the pairs that were looked at."""
    chain: dict[Link, int] = {0: 0} | {link: min(k, 9) for k, link in enumerate(YUMI.arms[0].links, start=1)}
    pairs = itertools.combinations(chain, 2)
    unchecked = tuple((a, b) for a, b in pairs if chain[b] - chain[a] < (5 if chain[a] else 4))
    ends = [joint.placement[0] for joint in YUMI.arms[0].joints[1:]]
    solids: list[tuple[Link, Box | Capsule]] = [
        (link, Capsule((0, 0, 0), ends[link - 1], radius))
        for link, radius in enumerate((0.06, 0.055, 0.05, 0.047, 0.042, 0.036), start=1)
    ]
    solids += [(7, Capsule((0, 0, -0.01), (0, 0, 0.004), 0.032)), ("hand", Box((0, 0, 0.042), (0.09, 0.05, 0.08)))]
    for finger in ("finger_a", "finger_b"):
        solids.append((finger, Box((-0.006, 0.0065, 0.028), (0.008, 0.014, 0.056))))
        solids.append((finger, Box((-0.001, 0.0065, 0.0443), (0.002, 0.016, 0.02))))
    body = [Box((-0.06, 0, 0.19), (0.2, 0.2, 0.36)), Box((-0.01, 0, 0.42), (0.16, 0.12, 0.16))]
    shapes = tuple(LinkShape(link, solid) for link, solid in solids)
    arms = tuple(dataclasses.replace(arm, shapes=shapes, unchecked=unchecked) for arm in YUMI.arms)
    return dataclasses.replace(YUMI, arms=arms, shapes=tuple(LinkShape(0, solid) for solid in body))


def reachable(count: int) -> Iterator[dict]:
    """How many poses have joints that are clear of everything, with the other arm at rest: grasps from above the tables by
    either arm, and any pose of an arm above the tables' height."""
    task, rng = load_task("yumi_stack"), np.random.default_rng(1)
    solvers = {arm: ArmKinematics(YUMI, arm) for arm in YUMI.arm_names}
    clearances = {"before": CellClearance(former(), task), "now": CellClearance(YUMI, task)}
    for kind in ("grasps", "any"):
        clear = {name: 0 for name in clearances}
        for k in range(count):
            arms = YUMI.arm_names if kind == "grasps" else (YUMI.arm_names[k % 2],)
            pose = _grasp(task, rng) if kind == "grasps" else _any(solvers[arms[0]], task, rng)
            solutions = [
                {**YUMI.home, arm: joints}
                for arm in arms
                for joints in solvers[arm].solutions(pose, YUMI.home[arm], seed=k, starts=20)
            ]
            for name, clearance in clearances.items():
                clear[name] += any(clearance.slack(joints) > 0 for joints in solutions)
        yield {"poses": kind, "count": count, **clear, "change": clear["now"] / clear["before"] - 1}


def _grasp(task: Task, rng: np.random.Generator) -> RigidTransform:
    table = task.tables[rng.integers(len(task.tables))]
    spread = rng.uniform(-0.5, 0.5, 2) * (np.array(table.size[:2]) - 0.04)
    place = np.array([*table.position[:2], table.top]) - task.robot_position + [*spread, rng.uniform(0.02, 0.18)]
    box = RigidTransform.from_components(place, Rotation.from_euler("z", rng.uniform(0, np.pi)))
    return grasp_poses(box, task.objects[0], YUMI.arms[0].gripper.opening)[0]


def _any(solver: ArmKinematics, task: Task, rng: np.random.Generator) -> RigidTransform:
    top = min(table.top for table in task.tables) - task.robot_position[2]
    while True:
        pose = solver.arm.forward(rng.uniform(solver.lower, solver.upper))
        if pose.translation[2] > top:
            return pose


def layouts(count: int) -> dict:
    """In how many layouts of the twin there is a way to the first box."""
    task, found = load_task("yumi_stack"), {}
    for name, robot in (("before", former()), ("now", YUMI)):
        planner, found[name] = Planner(robot, task), 0
        for seed in range(count):
            scene = build_scene(YUMI, task, seed)
            poses = box_poses(scene, scene.cell.qpos) | dict(scene.kits)
            with contextlib.suppress(Unplannable):
                planner.pick(task.object_names[0], Surroundings(poses, dict(YUMI.home)), YUMI.arm_names)
                found[name] += 1
    return {"poses": "layouts", "count": count, **found, "change": found["now"] / found["before"] - 1}


def speed(count: int) -> dict[str, float]:
    """Milliseconds that a look at the clearance takes, for the link."""
    task, rng, arm = load_task("yumi_stack"), np.random.default_rng(0), YUMI.arms[0]
    many = [{name: rng.uniform(arm.lower, arm.upper) for name in YUMI.arm_names} for _ in range(count)]
    milliseconds = {}
    for name, robot in (("before", former()), ("now", YUMI)):
        clearance = SafetyClearance(robot, task)()
        for where, asked in (("anywhere", many), ("at_rest", [YUMI.home] * count)):
            took = best_seconds(lambda: [clearance(joints) for joints in asked])  # noqa: B023
            milliseconds[f"{where}_{name}_ms"] = 1000 * took / count
    return milliseconds


def main(arguments: Arguments) -> None:
    surface = {name: np.array(points) for name, points in json.loads(arguments.surface.read_text()).items()}
    if arguments.fit:
        fit(surface)
        return
    rows = list(covering(surface))
    show("poses that an arm reaches", reach := [*reachable(arguments.poses), layouts(arguments.layouts)])
    report("collision_shapes", "YuMi's solids", rows, out=arguments.out, reach=reach, clearance=speed(500))


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
