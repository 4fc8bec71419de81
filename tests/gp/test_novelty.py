"""Hashes, duplicates, and offspring that are all new."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.behaviors import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.diversity import edit_distance, fitness_entropy, mean_edit_distance
from bt_jax.gp.novelty import duplicates, hash_trees
from bt_jax.gp.random_trees import random_trees
from bt_jax.gp.reproduction import reproduce
from bt_jax.gp.validity import is_valid
from tests.helpers.populations import PAPER, population, rows


def test_equal_hashes_are_equal_trees():
    trees = jax.tree.map(lambda field: jnp.concatenate([field, field[::-1]]), population(PAPER, 64, False))
    hashes = np.asarray(hash_trees(trees))
    assert len(np.unique(hashes, axis=0)) == len(np.unique(rows(trees), axis=0))
    for half in hashes.T:
        assert len(np.unique(half)) > 0.999 * len(np.unique(hashes, axis=0))


@given(st.lists(st.integers(0, 12), min_size=40, max_size=40))
def test_duplicates_are_all_but_the_first(values):
    hashes = jnp.array(values, jnp.uint32)[:, None] * jnp.array([[1, 7]], jnp.uint32)
    expected = [value in values[:i] for i, value in enumerate(values)]
    np.testing.assert_array_equal(duplicates(hashes), expected)


def test_offspring_are_new_valid_and_the_same_for_the_same_key():
    config = GPConfig(population=1000)
    trees = population(PAPER, 64, False)
    fitness = jax.random.normal(jax.random.key(0), (1000,))
    offspring, repeated = reproduce(jax.random.key(1), trees, fitness, PAPER, config)
    assert offspring.tokens.shape == (config.num_offspring, 64)
    assert int(repeated) == 0
    assert np.asarray(is_valid(offspring, PAPER)).all()
    known = set(map(bytes, rows(trees)))
    new = set(map(bytes, rows(offspring)))
    assert len(new) == config.num_offspring
    assert not known & new
    again, _ = reproduce(jax.random.key(1), trees, fitness, PAPER, config)
    np.testing.assert_array_equal(rows(offspring), rows(again))


def test_few_possible_trees_do_not_hang():
    alphabet, config = Alphabet(1, 1, 0), GPConfig(population=8, max_nodes=5, mutation_parents=8)
    trees = random_trees(jax.random.key(0), alphabet, count=8, num_nodes=5)
    offspring, repeated = reproduce(jax.random.key(1), trees, jnp.zeros(8), alphabet, config)
    assert np.asarray(is_valid(offspring, alphabet)).all()
    everything = [*map(bytes, rows(trees)), *map(bytes, rows(offspring))]
    assert config.num_offspring - len(set(everything) - set(map(bytes, rows(trees)))) == int(repeated)


def test_boosted_baseline_is_a_parent_of_crossover():
    config = GPConfig(baseline_index=0, max_nodes=32)
    marker = PAPER.end - 1
    trees = random_trees(jax.random.key(0), Alphabet(3, 2, 55), count=16, num_nodes=32)
    tree = [2, FIRST_LEAF, 1, marker, marker - 1]
    baseline = Trees(
        jnp.zeros(32, jnp.int16).at[:5].set(jnp.array(tree, jnp.int16)),
        jnp.zeros(32, jnp.uint8).at[:5].set(jnp.array([5, 1, 3, 1, 1], jnp.uint8)),
    )
    assert not (np.asarray(trees.tokens) == marker).any()
    hits = 0
    for seed in range(10):
        offspring, _ = reproduce(jax.random.key(seed), trees, jnp.zeros(16), PAPER, config, baseline=baseline)
        assert np.asarray(is_valid(offspring, PAPER)).all()
        crossed = np.asarray(offspring.tokens[-8:])
        hits += int((crossed == marker).any(axis=1).sum())
    assert hits >= 20


@given(st.data())
def test_edit_distance_is_levenshteins(data):
    words = [data.draw(st.lists(st.integers(1, 4), min_size=1, max_size=8)) for _ in range(2)]
    a, b = (
        Trees(
            jnp.zeros((1, 8), jnp.int16).at[0, : len(word)].set(jnp.array(word, jnp.int16)),
            jnp.zeros((1, 8), jnp.uint8).at[0, 0].set(len(word)),
        )
        for word in words
    )
    assert int(edit_distance(a, b)[0]) == _levenshtein(*words)


def _levenshtein(a: list[int], b: list[int]) -> int:
    row = list(range(len(b) + 1))
    for i, x in enumerate(a):
        row, before = [i + 1], row
        for j, y in enumerate(b):
            row.append(min(before[j + 1] + 1, row[j] + 1, before[j] + (x != y)))
    return row[-1]


def test_diversity_of_extremes():
    trees = population(PAPER, 64, False)
    same = jax.tree.map(lambda field: jnp.tile(field[:1], (10, 1)), trees)
    assert float(mean_edit_distance(jax.random.key(0), same)) == 0
    assert float(mean_edit_distance(jax.random.key(0), trees)) > 3
    assert float(fitness_entropy(jnp.zeros(8))) == 0
    np.testing.assert_allclose(fitness_entropy(jnp.arange(8.0)), np.log(8), rtol=1e-6)
    np.testing.assert_allclose(fitness_entropy(jnp.array([0.0, 0, 1, 1])), np.log(2), rtol=1e-6)
