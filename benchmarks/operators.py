"""How fast is one generation of the genetic operators? Selection, mutation, crossover, novelty, survival and validity of
whole populations, against the published procedure in plain Python."""

from __future__ import annotations

import dataclasses
import random
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks._report import best_seconds, report
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.random_trees import random_trees
from bt_jax.gp.reproduction import reproduce
from bt_jax.gp.selection import survivors
from bt_jax.gp.validity import is_valid
from bt_jax.tasks import load_task
from tests.helpers.published_gp import PublishedGP, from_trees


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Seconds of one generation by population."""

    populations: tuple[int, ...] = (16, 1_000, 10_000, 100_000)
    """populations to measure"""
    python_up_to: int = 10_000
    """largest population for plain Python with a set of known individuals"""
    list_up_to: int = 10_000
    """largest population for plain Python with a list of known individuals, whose cost is quadratic"""
    nodes: int = 8
    """nodes of the random trees of the population"""
    out: Path | None = None
    """where to write the JSON file"""


def main(arguments: Arguments) -> None:
    alphabet = Alphabet.of(gene_pool(load_task("stack")))
    rows = [measured(alphabet, population, arguments) for population in arguments.populations]
    report("operators", "One generation of operators (seconds)", rows, out=arguments.out)


def measured(alphabet: Alphabet, population: int, arguments: Arguments) -> dict[str, Any]:
    config = GPConfig(population=population)
    key = jax.random.key(0)
    trees = random_trees(key, alphabet, count=population, num_nodes=config.max_nodes, nodes=arguments.nodes)
    fitness = jax.random.normal(key, (population,))

    def generation(key: jax.Array, trees: Trees, fitness: jax.Array) -> tuple[Trees, jax.Array, jax.Array]:
        offspring, repeated = reproduce(key, trees, fitness, alphabet, config)
        kept = survivors(key, fitness, offspring.sizes[:, 0].astype(jnp.float32), config)
        next_trees = jax.tree.map(lambda old, new: jnp.concatenate([old, new])[kept], trees, offspring)
        return next_trees, repeated, jnp.all(is_valid(offspring, alphabet))

    began = perf_counter()
    compiled = jax.jit(generation).lower(key, trees, fitness).compile()
    compile_seconds = perf_counter() - began
    _, repeated, valid = compiled(key, trees, fitness)
    if not valid or repeated:
        raise AssertionError("an offspring is not valid or not new")
    seconds = best_seconds(lambda: compiled(key, trees, fitness))

    def python(limit: int, *, hashed: bool) -> float | None:
        return python_seconds(alphabet, config, trees, hashed=hashed) if population <= limit else None

    with_set, with_list = python(arguments.python_up_to, hashed=True), python(arguments.list_up_to, hashed=False)
    return {
        "population": population,
        "compile": compile_seconds,
        "bt_jax": seconds,
        "us each": 1e6 * seconds / population,
        "Python, list": with_list,
        "x list": with_list and with_list / seconds,
        "Python, set": with_set,
        "x set": with_set and with_set / seconds,
    }


def python_seconds(alphabet: Alphabet, config: GPConfig, trees: Trees, *, hashed: bool) -> float:
    """The published procedure on the same population, offspring checked once more like ours."""
    gp = PublishedGP(alphabet, config)
    population = from_trees(jax.tree.map(np.asarray, trees))
    fitness = [random.Random(0).gauss(0, 1) for _ in population]
    began = perf_counter()
    offspring = gp.reproduce(population, fitness, hashed=hashed)
    gp.survivors(fitness, [float(len(genome)) for genome in offspring])
    if not all(map(gp.is_valid, offspring)):
        raise AssertionError("an offspring is not valid")
    return perf_counter() - began


if __name__ == "__main__":
    main(tyro.cli(Arguments))
