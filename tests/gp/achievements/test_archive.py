"""The archive keeps the two best trees of each set of achievements, and nothing else."""

import numpy as np
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
    return Trees(tokens, sizes), np.array([fitness for _, fitness, _ in batch], np.float32), keys_of(achieved)


def once(batches):
    """Every tree in one episode only: a tree has one fitness and one set of achievements."""
    known = {}
    return [[(token, *known.setdefault(token, (fitness, achieved))) for token, fitness, achieved in b] for b in batches]


@given(batches)
def test_it_keeps_the_best_of_each_set(batches):
    archive, batches = Archive.empty(NODES), once(batches)
    for batch in batches:
        trees, fitness, keys = arrays(batch)
        rows = archive.entrants(fitness, keys)
        archive = archive.with_(trees[rows], fitness[rows], keys[rows])
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


@given(batches)
def test_parents_are_entries_of_the_archive(batches):
    trees, fitness, keys = arrays(once(batches)[0])
    archive = Archive.empty(NODES).with_(trees, fitness, keys)
    parents = archive.parents(np.random.default_rng(0), (2, 200))
    assert parents.shape == (2, 200)
    assert ((parents >= 0) & (parents < len(archive))).all()
    most = np.bitwise_count(archive.keys).max()
    share = (np.bitwise_count(archive.keys)[parents] == most).mean()
    assert share > 0.3
