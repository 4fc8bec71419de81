"""What `python -m bt_jax.experiments robust` does."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.markup import escape

from bt_jax._util.files import write_atomic
from bt_jax._util.startup import configure_jax
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.experiments.machine import machine
from bt_jax.experiments.robust.arguments import RobustArguments
from bt_jax.experiments.robust.models import CONDITIONS, MODELS, SEEDED, Model, known, make, solved
from bt_jax.experiments.robust.records import Records
from bt_jax.experiments.robust.report import Outcomes, figure, markdown
from bt_jax.tasks import load_faults, load_task

__all__ = ["run"]


def run(arguments: RobustArguments) -> None:
    """Make the trees, test them, and write the report; what an earlier call has found is not done again."""
    arguments.check()
    console = Console(highlight=False, soft_wrap=True)
    configure_jax("cpu")
    settings = {name: str(getattr(arguments, name)) for name in ("faults", "held_out", "seed", "layouts", "draws")}
    source = arguments.out / "results.json"
    records = Records.begun(source, settings)
    for name, (model, seed) in itertools.product(arguments.tasks, _wanted(arguments)):
        key = f"{name}/{model}/{seed}"
        if key in records.trees:
            continue
        began, faults = time.monotonic(), known(load_faults(arguments.faults), arguments.held_out)
        records.trees[key] = one_line(make(model, load_task(name), faults, arguments.seed + seed))
        records.seconds[key] = round(time.monotonic() - began, 2)
        records.save(source)
        console.print(f"{escape(key)}: {records.seconds[key]:.1f} s, {escape(records.trees[key])}")
    for name, condition in itertools.product(arguments.tasks, CONDITIONS):
        trees = dict.fromkeys(records.trees[f"{name}/{model}/{seed}"] for model, seed in _wanted(arguments))
        keys = {f"{name}/{condition}/{tree}": parse_tree(tree) for tree in trees}
        missing = {key: tree for key, tree in keys.items() if key not in records.tests}
        if missing:
            count = {"layouts": arguments.layouts, "draws": arguments.draws}
            found = solved(load_task(name), load_faults(arguments.faults), condition, list(missing.values()), **count)
            for key, row in zip(missing, found, strict=True):
                records.note(key, row)
            records.save(source)
            shares = ", ".join(f"{row.mean():.1%}" for row in found)
            console.print(f"{escape(name)}, {condition}: the trees solve {shares} of {found.shape[1]} episodes")
    outcomes = _outcomes(arguments, records)
    write_atomic(arguments.out / "robust.png", figure(outcomes))
    write_atomic(arguments.out / "report.md", markdown(outcomes, settings=settings, machine=machine()))
    console.print(f"report     {escape(str(arguments.out / 'report.md'))}")


def _wanted(arguments: RobustArguments) -> Iterator[tuple[Model, int]]:
    """Yield model and number of every tree for a task."""
    for model in MODELS:
        for seed in range(arguments.seeds if model in SEEDED else 1):
            yield model, seed


def _outcomes(arguments: RobustArguments, records: Records) -> list[Outcomes]:
    """Return what was found for each task and model."""
    episodes = arguments.layouts * arguments.draws
    found = []
    for name in arguments.tasks:
        for model in MODELS:
            seeds = range(arguments.seeds if model in SEEDED else 1)
            trees = tuple(records.trees[f"{name}/{model}/{seed}"] for seed in seeds)
            solved_by = {
                condition: np.stack([records.solved(f"{name}/{condition}/{tree}", episodes) for tree in trees])
                for condition in CONDITIONS
            }
            found.append(Outcomes(name, model, trees, solved_by))
    return found
