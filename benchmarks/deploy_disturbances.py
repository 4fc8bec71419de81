"""What a tree on the twin of the robot makes of whatever may go wrong: solved, or stopped, for which reason, and how soon.

python -m benchmarks.deploy_disturbances RUN_FOLDER|TREE [--kinds steal dark] [--seeds 5] [--first 5] [--factor 1.5]
"""

from __future__ import annotations

import dataclasses
import functools
import re
import statistics
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from benchmarks._report import RESULTS, report
from benchmarks._survey import accumulated, stored
from benchmarks._twin_runs import Job, carry_out, origin
from bt_jax.deploy.twin.disturbances import DISTURBANCES, disturbance

SOON = 20.0  # s within which a run that cannot be solved should stop
BOX = r"(Yellow|Green|Blue)Box"
UNSEEN = rf"{BOX}.* (is|are) not seen"
PICTURE = r"picture|dark|bright|light|image|not seen|soft|blur|flicker|nois"
MOVED_CAMERA = r"camera .*(off|moved|calibrat|turned)"
CONTACT = r"(?i:motion supervision|collision)|contact|something (unknown|holds)|in the way"
TRUE = {
    "swap": rf"{UNSEEN}|do not stay|no free way to (put|grasp) .*Box",
    "turn-early": rf"{CONTACT}|do not stay",
    "turn-late": CONTACT,
    "steal": rf"{UNSEEN}|closed on nothing",
    "lost-in-carry": rf"{UNSEEN}|slipped|lost|closed on nothing|seen elsewhere",
    "unknown-beside": rf"{CONTACT}|unknown",
    "unknown-on": rf"{CONTACT}|unknown|is covered|hides",
    "kit-moved": r"Kit.* (moved|not seen)|do not stay",
    "kit-covered": r"Kit.*not seen",
    "dark": PICTURE,
    "bright": PICTURE,
    "flicker": PICTURE,
    "noise": PICTURE,
    "blur-0.7": PICTURE,
    "blur-1.0": PICTURE,
    "camera-5mm": MOVED_CAMERA,
    "camera-1deg": MOVED_CAMERA,
    "duplicate-ids": r"twice|two (places|things)",
    "on-its-side": r"side|face|lies",
    "egm-lag": r"lag|from its setpoint|slow",
    "gripper-latency": r"fingers|gripper",
}


@dataclasses.dataclass(frozen=True)
class Arguments:
    source: Annotated[Path, tyro.conf.Positional]
    """run folder or tree"""
    kinds: tuple[str, ...] = tuple(DISTURBANCES)
    """of disturbances"""
    seeds: int = 5
    """layouts of each"""
    first: int = 0
    """of the layouts"""
    factor: float = 1.0
    """how many times as far from perfect as a real cell the twin is besides, see `Realism.scaled`"""
    width: int = 1280
    """of the images, px"""
    jobs: int = 1
    """runs at a time"""
    logs: Path | None = None
    """folder for the log of each run"""
    out: Path | None = None
    """where the JSON file is, to which runs are added"""


def verdict(record: dict[str, Any]) -> str:
    """Return in which column a run counts. The executor's success is what the robot believes: its reason says where the
    simulation knows better."""
    if record["status"] == "SUCCESS":
        return "solved" if record["solved"] else "wrong success"
    if not re.search(TRUE[record["disturbance"]], record["reason"]):
        return "other reason"
    return "true reason" if record["after"] <= SOON else "late"


def rows(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the table: a line for each kind."""
    by_kind: dict[tuple[str, float, int], list[dict[str, Any]]] = {}
    for record in records:
        by_kind.setdefault((record["disturbance"], record["factor"], record["width"]), []).append(record)
    order, table = list(DISTURBANCES), []
    for key in sorted(by_kind, key=lambda key: (order.index(key[0]), *key[1:])):
        (kind, factor, width), runs = key, by_kind[key]
        verdicts = [verdict(record) for record in runs]
        stops = [r["after"] for r, v in zip(runs, verdicts, strict=True) if v not in ("solved", "wrong success")]
        counts = {
            name: verdicts.count(name) for name in ("solved", "true reason", "late", "other reason", "wrong success")
        }
        median = statistics.median(stops) if stops else float("nan")
        named = {"disturbance": kind, "factor": factor, "width px": width, "runs": len(verdicts)}
        table.append({**named, **counts, "s to the stop": median})
    return table


def main(arguments: Arguments) -> None:
    console, path = Console(highlight=False, soft_wrap=True), arguments.out or RESULTS / "deploy_disturbances.json"
    for kind in arguments.kinds:
        disturbance(kind)
    own = origin(arguments.source)
    jobs = [
        Job(kind, seed, width=arguments.width, factor=arguments.factor, limit=120.0, **own)
        for seed in range(arguments.first, arguments.first + arguments.seeds)
        for kind in arguments.kinds
    ]
    work = functools.partial(carry_out, arguments.source, logs=arguments.logs)
    for record in accumulated(path, jobs, work, arguments.jobs):
        console.print(
            f"{record['disturbance']:16s} {record['seed']:3d}  {verdict(record):13s} {record['after']:6.1f} s  "
            f"{record['reason']}  [{record['touched']}]",
            markup=False,
        )
    found = rows(stored(path, **own))
    report("deploy_disturbances", "disturbances on the twin", found, out=path, runs=stored(path))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
