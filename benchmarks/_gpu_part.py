"""One part of `benchmarks.gpu`, in a process of its own; a row is one line of JSON, printed as soon as it is known."""

from __future__ import annotations

import collections
import dataclasses
import functools
import importlib.metadata
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import numpy as np
from jax.profiler import ProfileData

from benchmarks._report import machine
from bt_jax._util.errors import UserError
from bt_jax._util.startup import CompileClock
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.faults.fates import sample_fates
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.mjx import settle_fn
from bt_jax.mjx_env.physics.protocol import Physics, Settled
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take
from bt_jax.tasks import load_task, with_faults
from bt_jax.tasks.faults import PRESETS

NODES, MAX_NODES = 8, 16  # of the random trees, and room for them
LAYOUTS = 10
SETTLED = (1024, 4096)  # problems that are settled without trees, at most
NEAR = 0.002  # metres by which the final distances of two engines may differ
STAGES = ("collision", "constraints", "solver")  # scopes of one step in `mjx_env.physics.mjx_model`
TOP = 8  # lines of a profile
CHANCE = "harsh"  # what goes wrong in episodes with chance
COLUMNS = (  # that only some ways have
    "of it physics [s]",
    "simulated",
    "episodes/s, table full",
    "with chance, compile [s]",
    "with chance, run [s]",
    "with chance, episodes/s",
)


@dataclasses.dataclass
class Job:
    """What the parent asks for."""

    part: str
    implementation: str
    task: str
    sizes: list[int]
    trees: int
    seconds: float
    scratch: str

    def __post_init__(self) -> None:
        self.began = perf_counter()
        self.semantics = LeafSemantics(load_task(self.task), gene_pool(load_task(self.task)))

    @property
    def spent(self) -> float:
        """Seconds since the beginning of this part."""
        return perf_counter() - self.began

    @property
    def left(self) -> float:
        """Seconds until this part should have ended."""
        return self.seconds - self.spent

    def fitting(self) -> Iterator[int]:
        """The sizes, as long as there is time for another one like the last."""
        last = 0.0
        for size in sorted(self.sizes):
            if last > self.left:
                skip(f"no time was left for {size:,} episodes")
                return
            before = self.spent
            yield size
            last = self.spent - before

    @property
    def file(self) -> Path:
        return Path(self.scratch) / "trees.npz"

    def some_trees(self, count: int) -> Trees:
        with np.load(self.file) as saved:
            return Trees(saved["tokens"][:count], saved["sizes"][:count])

    def starts(self, count: int) -> tuple[World, np.ndarray]:
        """Layouts, and the one that each of `count` trees gets."""
        which = (np.arange(count, dtype=np.int32) % LAYOUTS)[:, None]
        return sample_layouts(self.semantics.task, 0, LAYOUTS), which


def say(kind: str, **row: Any) -> None:
    print(json.dumps({"kind": kind, **row}), flush=True)


def skip(reason: str) -> None:
    print(json.dumps({"skipped": reason}), flush=True)


def device(job: Job) -> None:
    """Where this is measured, and what is missing for a GPU."""
    backend = jax.default_backend()
    say("device", backend=backend, **machine(), warp=_version("warp-lang"), mjx=_version("mujoco-mjx"))
    if backend == "cpu":
        skip("JAX sees no accelerator, so everything below is measured on the CPU; `--help` says what to install")


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


def trees(job: Job) -> None:
    """Random trees for all other parts."""
    alphabet, most = Alphabet.of(job.semantics.vocabulary), max(*job.sizes, job.trees)
    found = random_trees(jax.random.key(0), alphabet, count=most, num_nodes=MAX_NODES, nodes=NODES)
    np.savez(job.file, tokens=np.asarray(found.tokens), sizes=np.asarray(found.sizes))


class Watched:
    """A physics backend whose time is added up."""

    def __init__(self, physics: Physics) -> None:
        self.physics, self.name, self.description, self.seconds = physics, physics.name, physics.description, 0.0

    def settle(self, kit: Any, poses: Any, present: Any) -> Settled:
        began = perf_counter()
        settled = jax.block_until_ready(self.physics.settle(kit, poses, present))
        self.seconds += perf_counter() - began
        return settled


def engine(job: Job) -> None:
    """The C engine alone, and behind the transition table."""
    physics = make_physics(job.semantics.task, "mujoco")
    settling(job, physics, "C engine")
    table(job, physics, "C engine, table")
    rollout(job, physics, "C engine")


def mjx_table(job: Job) -> None:
    """MJX alone, whether it agrees with the C engine, and behind the transition table."""
    physics = make_physics(job.semantics.task, "mjx", implementation=job.implementation)
    settling(job, physics, f"MJX {job.implementation}")
    trees, starts = job.some_trees(job.trees), job.starts(job.trees)
    ours, reference = (
        TableEvaluator(job.semantics, backend, batch=job.trees)(trees, *starts)
        for backend in (physics, make_physics(job.semantics.task, "mujoco"))
    )
    near = np.abs(ours.misses.distance - reference.misses.distance).max(axis=(1, 2)) < NEAR
    same = (ours.ending == reference.ending) & (ours.solved == reference.solved)
    shares = {"same verdict": float(same.mean()), "within 2 mm": float(near.mean())}
    say("parity", mjx=job.implementation, trees=job.trees, **shares)
    table(job, physics, f"MJX {job.implementation}, table")


def settling(job: Job, physics: Physics, way: str) -> None:
    """Boxes let go over the tables, without any trees."""
    for count in sorted({min(most, max(job.sizes)) for most in SETTLED}):
        problems = falling_boxes(job, count)
        seconds, compiling, _ = timed(job, lambda: jax.block_until_ready(physics.settle(*problems)))  # noqa: B023
        rates = {"compile [s]": compiling, "run [s]": seconds, "problems/s": count / seconds}
        say("settling", way=way, problems=count, **rates)


def falling_boxes(job: Job, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Problems for `Physics.settle`: layouts whose boxes are up to a third of their size above the tables."""
    layouts, which = job.starts(count)
    start = take(layouts, which[:, 0])
    poses = start.poses.copy()
    height = np.random.default_rng(0).uniform(0, 0.3, poses.shape[:2]) * job.semantics.task.objects[0].edge
    poses[..., 2] += height.astype(np.float32)
    return start.kits, poses, np.ones(poses.shape[:2], bool)


def table(job: Job, physics: Physics, way: str) -> None:
    for size in job.fitting():
        trees, starts = job.some_trees(size), job.starts(size)

        def run() -> tuple[TableEvaluator, Watched]:
            watched = Watched(physics)
            evaluator = TableEvaluator(job.semantics, watched, batch=size)  # noqa: B023  called in this iteration
            evaluator(trees, *starts)  # noqa: B023
            return evaluator, watched

        seconds, compiling, (evaluator, watched) = timed(job, run)
        began = perf_counter()
        evaluator(trees, *starts)
        again = perf_counter() - began
        share = {"of it physics [s]": watched.seconds, "simulated": evaluator.table.settler.solved}
        speed(way, size, seconds, compiling, **share, **{"episodes/s, table full": size / again})


def mjx_rollout(job: Job) -> None:
    """Every transition of every episode simulated by MJX, all on the device."""
    rollout(
        job, make_physics(job.semantics.task, "mjx", implementation=job.implementation), f"MJX {job.implementation}"
    )


def rollout(job: Job, physics: Physics, way: str) -> None:
    """Rollouts, without chance and with a fate of its own for every episode."""
    for size in job.fitting():
        trees, (layouts, which) = job.some_trees(size), job.starts(size)
        evaluator = RolloutEvaluator(job.semantics, physics, batch=size)
        seconds, compiling, _ = timed(job, functools.partial(evaluator, trees, layouts, which))
        unlike = LeafSemantics(with_faults(job.semantics.task, PRESETS[CHANCE]), job.semantics.vocabulary)
        fates = sample_fates(unlike.task, 0, layouts=LAYOUTS, draws=-(-size // LAYOUTS), continuous=True)
        starts = take(sample_layouts(unlike.task, 0, LAYOUTS), np.arange(size) % LAYOUTS)
        own = np.arange(size, dtype=np.int32)[:, None]
        evaluator = RolloutEvaluator(unlike, physics, batch=size)
        with_chance, compiling_chance, _ = timed(job, functools.partial(evaluator, trees, starts, own, fates))
        more = {"compile [s]": compiling_chance, "run [s]": with_chance, "episodes/s": size / with_chance}
        speed(f"{way}, rollout", size, seconds, compiling, **{f"with chance, {name}": more[name] for name in more})


def timed(job: Job, run: Callable[[], Any]) -> tuple[float, float, Any]:
    """Seconds of a run, seconds that the first one took longer because it compiled, and what the last one returned. If
    there is no time for a second run, JAX's own account of its compiling has to do."""
    began = perf_counter()
    with CompileClock() as clock:
        result = run()
    first = perf_counter() - began
    if job.left < first:
        return first - clock.seconds, clock.seconds, result
    began = perf_counter()
    result = run()
    seconds = perf_counter() - began
    return seconds, first - seconds, result


def speed(way: str, episodes: int, seconds: float, compiling: float, **more: float) -> None:
    columns = dict.fromkeys(COLUMNS) | more
    rate = episodes / seconds
    say(
        "speed",
        way=way,
        episodes=episodes,
        **{"compile [s]": compiling, "run [s]": seconds, "episodes/s": rate},
        **columns,
    )


def profile(job: Job) -> None:
    """Where the time of settling goes, the slowest part of every way: its stages, then its longest operations."""
    count = min(max(job.sizes), max(SETTLED))
    problems = falling_boxes(job, count)
    compiled = jax.jit(settle_fn(job.semantics.task)).lower(*problems).compile()
    jax.block_until_ready(compiled(*problems))
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            jax.block_until_ready(compiled(*problems))
        trace = next(Path(folder).rglob("*.xplane.pb"))
        spent = _operations(ProfileData.from_file(str(trace)), _scopes(compiled.as_text()))
    whole = sum(spent.values())
    stages: collections.Counter[str] = collections.Counter()
    for (stage, _), nanoseconds in spent.items():
        stages[stage] += nanoseconds
    for stage, nanoseconds in stages.most_common():
        say(
            "profile",
            settling=count,
            stage=stage,
            operation="all of it",
            ms=nanoseconds / 1e6,
            share=nanoseconds / whole,
        )
    for (stage, operation), nanoseconds in spent.most_common(TOP):
        say(
            "profile", settling=count, stage=stage, operation=operation, ms=nanoseconds / 1e6, share=nanoseconds / whole
        )


def _scopes(program: str) -> dict[str, str]:
    """The stage of each instruction of a compiled program, other than those that contain instructions."""
    found = {}
    for name, opcode, scope in re.findall(r"%([\w.-]+) = .*? ([\w-]+)\(.*op_name=\"([^\"]*)\"", program):
        if opcode not in ("while", "call", "conditional"):
            found[name] = next((stage for stage in STAGES if stage in scope), "bookkeeping")
    return found


def _operations(trace: ProfileData, scopes: dict[str, str]) -> collections.Counter[tuple[str, str]]:
    """Nanoseconds by stage and operation: of an accelerator's streams if there are any, else of the CPU's threads."""
    spent: collections.Counter[tuple[str, str]] = collections.Counter()
    planes = [plane for plane in trace.planes if plane.name.startswith("/device:")]
    on_device = any(True for plane in planes for _ in plane.lines)
    for plane in planes if on_device else trace.planes:
        for line in plane.lines:
            if on_device and not line.name.startswith("Stream"):
                continue
            for event in line.events:
                operation = str(dict(event.stats).get("hlo_op", event.name))
                if operation in scopes or on_device:
                    spent[scopes.get(operation, "unknown"), operation] += event.duration_ns
    return spent


PARTS: dict[str, Callable[[Job], None]] = {
    "device": device,
    "trees": trees,
    "engine": engine,
    "table": mjx_table,
    "rollout": mjx_rollout,
    "profile": profile,
}


def main() -> None:
    job = Job(**json.loads(sys.argv[1]))
    try:
        PARTS[job.part](job)
    except UserError as error:  # such as warp without a GPU
        skip(str(error))


if __name__ == "__main__":
    main()
