"""The archive keeps the two best trees of each set of achievements, and nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.archive import PER_KEY, Archive, keys_of

NODES, ACHIEVEMENTS = 4, 3
entry = st.tuples(st.integers(3, 12), st.integers(-5, 5), st.lists(st.booleans(), min_size=3, max_size=3))
batches = st.lists(st.lists(entry, min_size=1, max_size=8), min_size=1, max_size=5)


def arrays(batch):
    tokens = np.zeros((len(batch), NODES), np.int16)
    tokens[:, 0] = [token for token, _, _ in batch]
    sizes = (tokens > 0).astype(np.uint8)
    achieved = np.array([achieved for *_, achieved in batch])
    missed = (1 - achieved).astype(np.float32)
    fitness = np.array([fitness for _, fitness, _ in batch], np.float32)
    return Archive(Trees(tokens, sizes), fitness, keys_of(achieved), missed)


def once(batches):
    """Every tree in one episode only: a tree has one fitness and one set of achievements."""
    known = {}
    return [[(token, *known.setdefault(token, (fitness, achieved))) for token, fitness, achieved in b] for b in batches]


@given(batches, st.booleans())
def test_it_keeps_the_best_of_each_set(batches, drift):
    archive, batches = Archive.empty(NODES, ACHIEVEMENTS), once(batches)
    for batch in batches:
        others = arrays(batch)
        archive = archive.with_(others.at(archive.entrants(others.fitness, others.keys, drift=drift)))
    np.testing.assert_array_equal(archive.missed == 0, archive.achieved(ACHIEVEMENTS))
    everything = {token: (tuple(achieved), fitness) for batch in batches for token, fitness, achieved in batch}
    kept = {}
    for i, row in enumerate(archive.achieved(ACHIEVEMENTS)):
        kept.setdefault(tuple(row.tolist()), []).append(float(archive.fitness[i]))
        token = int(archive.trees.tokens[i, 0])
        assert everything[token] == (tuple(row.tolist()), float(archive.fitness[i]))
    best = {}
    for achieved, fitness in everything.values():
        best.setdefault(achieved, []).append(float(fitness))
    assert kept == {achieved: sorted(values, reverse=True)[:PER_KEY] for achieved, values in best.items()}


@pytest.mark.parametrize(("drift", "kept"), [(False, [3, 4]), (True, [5, 6])])
def test_with_drift_a_tree_that_is_as_fit_takes_the_place_of_an_earlier_one(drift, kept):
    same = [True, False, False]
    archive = Archive.empty(NODES, ACHIEVEMENTS).with_(arrays([(3, 1, same), (4, 1, same)]))
    later = arrays([(5, 1, same), (6, 1, same), (7, 0, same)])
    archive = archive.with_(later.at(archive.entrants(later.fitness, later.keys, drift=drift)))
    assert archive.trees.tokens[:, 0].tolist() == kept


@given(batches)
def test_parents_are_entries_of_the_archive(batches):
    archive = Archive.empty(NODES, ACHIEVEMENTS).with_(arrays(once(batches)[0]))
    parents = archive.parents(np.random.default_rng(0), (2, 200))
    assert parents.shape == (2, 200)
    assert ((parents >= 0) & (parents < len(archive))).all()
    most = np.bitwise_count(archive.keys).max()
    share = (np.bitwise_count(archive.keys)[parents] == most).mean()
    assert share > 0.3
