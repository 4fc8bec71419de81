"""Parents and survivors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.gp.config import GPConfig, Selection
from bt_jax.gp.selection import niche_strength, select, survivors, tournament

fitnesses = st.lists(st.sampled_from([-3.0, -2.0, -1.0, 0.0, 5.0]), min_size=8, max_size=8)


@pytest.mark.parametrize("method", list(Selection))
@given(fitness=fitnesses, seed=st.integers(0, 100))
def test_no_index_twice(method, fitness, seed):
    chosen = np.asarray(select(method, jax.random.key(seed), jnp.array(fitness), 5))
    assert len(set(chosen.tolist())) == 5
    assert set(chosen.tolist()) <= set(range(8))


@pytest.mark.parametrize(("count", "num"), [(16, 12), (16, 4), (17, 12), (32, 14), (9, 9), (100, 3)])
def test_the_best_always_wins_a_tournament(count, num):
    fitness = jax.random.normal(jax.random.key(0), (count,))
    for seed in range(10):
        chosen = np.asarray(tournament(jax.random.key(seed), fitness, num))
        assert int(jnp.argmax(fitness)) in chosen
        assert len(set(chosen.tolist())) == num


def test_tournament_of_all_pairs_leaves_the_worst_out_and_everyone_in_sometimes():
    fitness = jnp.arange(16, dtype=jnp.float32)
    chosen = np.stack([tournament(jax.random.key(seed), fitness, 8) for seed in range(200)])
    share = np.bincount(chosen.ravel(), minlength=16) / 200
    assert share[0] == 0
    np.testing.assert_allclose(share, np.arange(16) / 15, atol=0.12)


@pytest.mark.parametrize("method", [Selection.RANK, Selection.ADJUSTABLE_RANK])
def test_ranks_prefer_the_better(method):
    fitness = jnp.arange(16, dtype=jnp.float32)
    chosen = np.stack([select(method, jax.random.key(seed), fitness, 4) for seed in range(300)])
    share = np.bincount(chosen.ravel(), minlength=16)
    assert share[8:].sum() > 1.8 * share[:8].sum() > 0


def test_equals_are_drawn_evenly_under_adjustable_rank():
    chosen = np.stack(
        [select(Selection.ADJUSTABLE_RANK, jax.random.key(seed), jnp.zeros(16), 4) for seed in range(300)]
    )
    np.testing.assert_allclose(np.bincount(chosen.ravel(), minlength=16) / 300, 0.25, atol=0.11)


@given(st.lists(st.integers(-50, 0), min_size=48, max_size=48), st.integers(0, 100))
def test_survivors_are_elites_and_winners_of_the_pool(values, seed):
    config = GPConfig(old_share=0.1)
    values = np.array(values, np.float32)
    chosen = np.asarray(survivors(jax.random.key(seed), jnp.array(values[:16]), jnp.array(values[16:]), config))
    assert len(set(chosen.tolist())) == 16
    old = np.argsort(-values[:16], kind="stable")[:2]
    pool = [*old, *range(16, 48)]
    assert set(chosen.tolist()) <= set(pool)
    best = sorted((values[i] for i in pool), reverse=True)
    assert [values[i] for i in chosen[:2]] == best[:2]


niches = st.lists(st.tuples(st.integers(-9, 0), st.integers(0, 3)), min_size=24, max_size=24)


@given(niches)
def test_strength_ranks_the_best_of_every_niche_before_the_second_best_of_any(individuals):
    fitness, niche = (np.array(column) for column in zip(*individuals, strict=True))
    strength = np.asarray(niche_strength(jnp.array(fitness, jnp.float32), jnp.array(niche, jnp.int32)))
    assert sorted(strength) == list(range(24))
    assert fitness[strength.argmax()] == fitness.max()
    by_niche = [np.argsort(-strength)[niche[np.argsort(-strength)] == kind] for kind in np.unique(niche)]
    for members in by_niche:
        values = fitness[members]
        distinct = len(set(values))
        np.testing.assert_array_equal(values[:distinct], np.unique(fitness[members])[::-1])
    for turn in range(24):
        ours = [strength[members[turn]] for members in by_niche if len(members) > turn]
        later = [strength[members[turn + 1]] for members in by_niche if len(members) > turn + 1]
        assert not later or min(ours) > max(later)


@given(niches)
def test_every_niche_gets_the_same_number_of_survivors_or_keeps_all(individuals):
    fitness, niche = (np.array(column) for column in zip(*individuals, strict=True))
    config = GPConfig(population=8, survivor_selection=Selection.ELITISM, niches=True)
    values, kinds = jnp.array(fitness, jnp.float32), jnp.array(niche, jnp.int32)
    chosen = np.asarray(survivors(jax.random.key(0), values[:8], values[8:], config, kinds[:8], kinds[8:]))
    kept, had = (np.bincount(part, minlength=4) for part in (niche[chosen], niche))
    assert len(set(chosen.tolist())) == 8
    assert all(kept[kind] == had[kind] or kept[kind] >= kept.max() - 1 for kind in range(4))
