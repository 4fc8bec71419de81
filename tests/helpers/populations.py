"""What the tests of the operators share: alphabets of all sizes, and populations that have been mutated a while."""

import functools

import jax
import numpy as np
import pytest

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import MutationConfig
from bt_jax.gp.mutation import mutate
from bt_jax.gp.random_trees import random_trees

PAPER = Alphabet(3, 2, 57)
SLOW = pytest.mark.slow
CASES = (
    # alphabet, nodes that fit, genes under a Fallback
    pytest.param(PAPER, 64, False, id="paper"),
    pytest.param(Alphabet(1, 1, 0), 8, False, id="one-of-each"),
    pytest.param(Alphabet(2, 0, 2), 10, True, id="no-actions"),
    pytest.param(PAPER, 24, True, id="genes-anywhere", marks=SLOW),
    pytest.param(PAPER, 255, False, id="long", marks=SLOW),
    pytest.param(Alphabet(3, 2, 5), 8, False, id="full", marks=SLOW),
    pytest.param(Alphabet(4, 3, 0), 16, False, id="no-genes", marks=SLOW),
    pytest.param(Alphabet(0, 2, 0), 8, True, id="no-conditions", marks=SLOW),
    pytest.param(Alphabet(0, 0, 3), 12, False, id="only-genes", marks=SLOW),
)
NODES = 6  # of the random trees that populations grow from

mutate_once = jax.jit(mutate, static_argnames=("alphabet", "config", "max_nodes"))


def growing(gene_under_fallback: bool = False) -> MutationConfig:
    return MutationConfig(add=1.0, delete=0.0, change=0.0, gene_under_fallback=gene_under_fallback)


@functools.cache
def population(
    alphabet: Alphabet, num_nodes: int, gene_under_fallback: bool, count: int = 1000, steps: int = 4
) -> Trees:
    """Valid trees of many sizes and shapes, up to full ones where `num_nodes` is small; the first ones of a single leaf if
    any steps were taken."""
    trees = random_trees(
        jax.random.key(1),
        alphabet,
        count=count,
        num_nodes=num_nodes,
        nodes=NODES,
        gene_under_fallback=gene_under_fallback,
    )
    config = growing(gene_under_fallback)
    for step in range(steps):
        trees = mutate_once(jax.random.key(step), trees, alphabet, config)
    if not steps:
        return trees
    return jax.tree.map(lambda all_, some: all_.at[: some.shape[0]].set(some), trees, lone_leaves(alphabet, num_nodes))


def lone_leaves(alphabet: Alphabet, num_nodes: int) -> Trees:
    """Trees of a single action or gene, as baselines are; the first and the last of them."""
    tokens = np.zeros((2, num_nodes), np.int16)
    sizes = np.zeros((2, num_nodes), np.uint8)
    tokens[:, 0], sizes[:, 0] = (alphabet.first_action, alphabet.end - 1), 1
    return Trees(tokens, sizes)


def rows(trees: Trees) -> np.ndarray:
    """Tokens and sizes of each tree as one row, to compare trees with."""
    return np.concatenate([np.asarray(trees.tokens), np.asarray(trees.sizes)], axis=1)
