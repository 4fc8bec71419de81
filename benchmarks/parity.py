"""Do the two physics backends agree? Random problems through C MuJoCo and MJX, and a class for every difference.

python -m benchmarks.parity --count 1000

`drops`: one object let go over a table, a kit, an edge or another object, free of anything else. `piles`: objects put where
genes would put them, also into each other, as evolution does. A verdict is which object rests on what.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import jax
import mujoco
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Kind, gene_pool
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.protocol import Settled
from bt_jax.mjx_env.scene.mjcf import compile_scene, timing
from bt_jax.mjx_env.scene.placement import draw_kit_table
from bt_jax.mjx_env.surfaces import fixed_surfaces, joined, object_surfaces, support_height
from bt_jax.tasks import Task, load_task
from bt_jax.tasks.support import kit_origin

NEAR = 0.002  # metres at boxes of 0.1 m, in proportion for others; poses nearer than this agree
JITTER = 1e-5  # metres; a problem whose outcome changes with so little is sensitive


@dataclasses.dataclass(frozen=True)
class Problems:
    """A batch for `Physics.settle`."""

    kits: np.ndarray
    poses: np.ndarray
    present: np.ndarray

    def settle(self, physics) -> Settled:
        return jax.tree.map(np.asarray, physics.settle(self.kits, self.poses, self.present))


@dataclasses.dataclass(frozen=True)
class Options:
    task: str = "stack3"
    """name of a task or a .yaml file"""
    count: int = 1000
    """problems of each kind"""
    seed: int = 0
    """of the random problems"""
    out: Path = Path(__file__).parent / "results" / "parity.json"
    """JSON file for the results"""


def drops(task: Task, rng: np.random.Generator, count: int) -> Problems:
    """One box let go, up to 1.5 sizes above what is under it, while the others rest apart; nothing overlaps."""
    return _batch(task, rng, count, _drop)


def piles(task: Task, rng: np.random.Generator, count: int) -> Problems:
    """Boxes at rest, then one to three of them put where a random gene would put them, some turned, some missing."""
    return _batch(task, rng, count, _pile)


def _batch(task: Task, rng: np.random.Generator, count: int, one: Callable) -> Problems:
    return Problems(*(np.stack(field) for field in zip(*(one(task, rng) for _ in range(count)), strict=True)))


def _resting(task: Task, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    kit_table = task.tables[draw_kit_table(task, rng)]
    kits = np.array([kit_origin(task, kit_table, name) for name in task.kit_names], np.float32)
    taken = {kit.table or kit_table.name for kit in task.kits}
    others = [table for table in task.tables if table.name not in taken]
    poses = np.zeros((len(task.objects), 7), np.float32)
    for i, thing in enumerate(task.objects):
        while True:
            place = others[rng.integers(len(others))]
            spread = np.array(place.size[:2]) - 2 * task.layout.margin
            xy = np.array(place.position[:2]) + rng.uniform(-0.5, 0.5, 2) * spread
            if all(
                np.hypot(*(xy - pose[:2])) > thing.radius + other.radius
                for other, pose in zip(task.objects[:i], poses, strict=False)
            ):
                break
        poses[i] = (*xy, place.top + thing.height / 2, *_yaw(rng.uniform(-0.8, 0.8) if rng.random() < 0.5 else 0))
    return kits, poses, np.ones(len(task.objects), bool)


def _yaw(angle: float) -> tuple[float, float, float, float]:
    return np.cos(angle / 2), 0, 0, np.sin(angle / 2)


def _drop(task: Task, rng: np.random.Generator):
    kits, poses, present = _resting(task, rng)
    which = rng.integers(len(task.objects))
    thing = task.objects[which]
    lift = rng.choice([0.03, 0.05, 0.3, 1.5]) * thing.edge
    above = rng.integers(4)
    if above == 0:  # a table, also over its edge
        table = task.tables[rng.integers(len(task.tables))]
        xy = np.array(table.position[:2]) + rng.uniform(-0.5, 0.5, 2) * (np.array(table.size[:2]) + 0.8 * thing.edge)
    elif above in (1, 2):  # a kit, walls and all
        at = rng.integers(len(kits))
        half = np.array(task.kits[at].half) + (0.5 * thing.edge if above == 1 else -0.55 * thing.edge)
        xy = kits[at, :2] + rng.uniform(-1, 1, 2) * np.maximum(half, 0)
    else:
        xy = poses[rng.integers(len(task.objects)), :2] + rng.uniform(-0.6, 0.6, 2) * thing.edge
    turned = _yaw(rng.uniform(-0.8, 0.8) if rng.random() < 0.5 else 0)
    surfaces = joined(fixed_surfaces(task, kits[None]), object_surfaces(task, poses[None]))
    usable = np.arange(surfaces.top.shape[1])[None] != surfaces.top.shape[1] - len(poses) + which
    around = np.full((1, 2), thing.radius, np.float32)  # what is further off is not under the object
    lowest = support_height(surfaces, xy[None].astype(np.float32), around, usable)[0] + thing.height / 2
    poses[which] = (*xy, lowest + lift, *turned)
    return kits, poses, present


def _pile(task: Task, rng: np.random.Generator):
    kits, poses, present = _resting(task, rng)
    genes = [leaf for leaf in gene_pool(task).leaves if leaf.kind == Kind.GENE]
    for _ in range(rng.integers(1, 4)):
        gene = genes[rng.integers(len(genes))]
        if gene.frame in task.kit_names:
            place = kits[task.kit_names.index(gene.frame)] + np.array(gene.position)
        else:
            frame = poses[task.object_names.index(gene.frame)].astype(float)
            offset = np.zeros(3)
            mujoco.mju_rotVecQuat(offset, np.array(gene.position), frame[3:])
            place = frame[:3] + offset
        turned = _yaw(rng.uniform(-0.8, 0.8) if rng.random() < 0.3 else math.radians(gene.turn or 0))
        name = rng.choice(task.instances[gene.object])
        poses[task.object_names.index(name)] = (*place, *turned)
    present = rng.random(len(poses)) < 0.85
    present[rng.integers(len(poses))] = True
    return kits, poses, present


class Judge:
    """Looks at contacts with the C engine."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.model, self.ids = compile_scene(task)
        self.data = mujoco.MjData(self.model)

    def contacts(self, kits, poses, present, *, margin: float = 0.0) -> list[tuple[str, str, float, float]]:
        """Touching pairs (first, second, distance [m], z of the normal from first to second) of the present boxes."""
        absent = {name for name, here in zip(self.task.object_names, present, strict=True) if not here}
        self.model.geom_margin[:] = margin
        self.data.qpos[:] = poses.ravel()
        self.data.mocap_pos[list(self.ids.kit_mocaps)] = kits
        mujoco.mj_forward(self.model, self.data)
        self.model.geom_margin[:] = 0
        found = []
        for contact in self.data.contact:
            names = [self.model.geom(geom).name for geom in contact.geom]
            if not absent & set(names):
                found.append((*names, float(contact.dist), float(contact.frame[2])))
        return found

    def verdict(self, kits, poses, present) -> set[tuple[str, str]]:
        """(box, what carries it) for every box."""
        carried = set()
        for first, second, _, up in self.contacts(kits, poses, present, margin=0.02 * timing(self.task).size):
            if abs(up) > 0.7:
                carried.add((second, first) if up > 0 else (first, second))
        return carried


def compare(task: Task, problems: Problems, backends, judge: Judge) -> dict:
    """Agreement of the two backends on the problems, and each difference with its reason."""
    scale = timing(task).size / 0.1
    reference, other = (problems.settle(physics) for physics in backends)
    jittered = dataclasses.replace(problems, poses=problems.poses.copy())
    noise = np.random.default_rng(0).normal(size=problems.poses[..., :2].shape) * JITTER * scale
    jittered.poses[..., :2] += noise.astype(np.float32)
    shaken = jittered.settle(backends[0])

    def apart(a: Settled, b: Settled) -> np.ndarray:
        away = np.linalg.norm(a.poses[..., :3] - b.poses[..., :3], axis=-1)
        return np.where(problems.present, away, 0).max(axis=1) / scale

    far, sensitive = apart(reference, other), apart(reference, shaken) > NEAR
    travelled = np.where(problems.present, reference.reach, 0).max(axis=1) / timing(task).size
    differences, same = [], np.ones(len(far), bool)
    overlapping = np.zeros(len(far), bool)
    for i in range(len(far)):
        kits, start, present = problems.kits[i], problems.poses[i], problems.present[i]
        contacts = judge.contacts(kits, start, present)
        depth = -min((distance for *_, distance, _ in contacts), default=0.0) / scale
        overlapping[i] = depth > NEAR
        verdicts = [judge.verdict(kits, settled.poses[i], present) for settled in (reference, other)]
        same[i] = verdicts[0] == verdicts[1]
        if far[i] > NEAR or not same[i]:
            differences.append(
                {
                    "problem": i,
                    "reason": _reason(start[present], depth, sensitive[i], far[i], travelled[i], scale),
                    "apart_mm": round(1e3 * float(far[i]), 2),
                    "verdicts": [sorted(map(list, verdict)) for verdict in verdicts],
                    "contacts_at_start": [[*names, round(1e3 * d, 2)] for *names, d, _ in _deepest(contacts)],
                }
            )
    free = ~overlapping
    return {
        "problems": len(far),
        "within_2mm": float(np.mean(far <= NEAR)),
        "same_verdict": float(np.mean(same)),
        "free_problems": int(free.sum()),
        "free_within_2mm": float(np.mean(far[free] <= NEAR)),
        "free_same_verdict": float(np.mean(same[free])),
        "mujoco_sensitive": float(np.mean(sensitive)),
        "differences": differences,
    }


def _deepest(contacts):
    pairs = {}
    for first, second, distance, up in contacts:
        if distance < pairs.get((first, second), (0.0, 0.0))[0]:
            pairs[first, second] = (distance, up)
    return [(*names, *value) for names, value in pairs.items()]


def _reason(start, depth: float, sensitive: bool, far: float, travelled: float, scale: float) -> str:
    centres = start[:, :3]
    gaps = [np.linalg.norm(a - b) for i, a in enumerate(centres) for b in centres[:i]]
    if gaps and min(gaps) < 0.01 * scale:
        return "two boxes released in one place"
    if depth > NEAR:
        return "released inside something"
    if sensitive:
        return "sensitive: 0.01 mm change the result of the C engine too"
    if travelled > 0.2:
        return "moved further than 0.2 sizes: tipped or fell"
    return "near in place, other verdict" if far <= NEAR else "moved less than 0.2 sizes"


def main(options: Options) -> None:
    configure_jax()
    task = load_task(options.task)
    backends = [make_physics(task, "mujoco"), make_physics(task, "mjx")]
    judge = Judge(task)
    results = {"task": task.name, "seed": options.seed, "device": jax.default_backend()}
    table = Table(
        "problems",
        "count",
        "within 2 mm",
        "same verdict",
        "C sensitive to 0.01 mm",
        title=f"mjx against mujoco, {task.name}",
    )
    began = time.perf_counter()
    for kind in (drops, piles):
        problems = kind(task, np.random.default_rng(options.seed), options.count)
        result = results[kind.__name__] = compare(task, problems, backends, judge)
        rows = [("", "problems", "within_2mm", "same_verdict")]
        rows += [(", nothing overlapping", "free_problems", "free_within_2mm", "free_same_verdict")]
        for suffix, number, within, same in rows:
            shaky = f"{result['mujoco_sensitive']:.1%}" if not suffix else ""
            table.add_row(
                kind.__name__ + suffix, str(result[number]), f"{result[within]:.1%}", f"{result[same]:.1%}", shaky
            )
    results["seconds"] = round(time.perf_counter() - began, 1)
    console = Console()
    console.print(table)
    for kind in (drops, piles):
        reasons = [difference["reason"] for difference in results[kind.__name__]["differences"]]
        for reason in sorted(set(reasons)):
            console.print(f"{kind.__name__}: {reasons.count(reason)} x {reason}")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
