import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import Evolution, best_of
from bt_jax.gp.validity import is_valid
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS
from tests.helpers.samples import assert_same

ALPHABET = Alphabet(num_conditions=3, num_actions=2, num_genes=10)
CONFIG = GPConfig(population=8, generations=6, max_nodes=16)
GOOD = ALPHABET.first_gene + 3


def evaluate(trees: Trees) -> np.ndarray:
    """Trees should be short and hold one gene; a tie-breaker that knows every token tells trees apart."""
    tokens = np.asarray(trees.tokens).astype(np.float64)
    places = np.arange(1, tokens.shape[-1] + 1)
    nodes = np.asarray(trees.sizes)[..., 0]
    fitness = 100.0 * (tokens == GOOD).any(axis=-1) - 10.0 * nodes - (tokens * places).sum(axis=-1) / 1e4
    return fitness.astype(np.float32)


def states(config=CONFIG, **options):
    evolution = Evolution(config, ALPHABET, evaluate, **options)
    return evolution, list(evolution.run())


@pytest.fixture(scope="module")
def single():
    return states()


def test_each_generation_is_a_population_of_valid_trees(single):
    _, found = single
    assert [state.generation for state in found] == list(range(7))
    for state in found:
        trees = jax.tree.map(lambda leaf: leaf[0], state.population.trees)
        assert trees.tokens.shape == (8, 16)
        assert is_valid(trees, ALPHABET, gene_under_fallback=False).all()
        np.testing.assert_array_equal(state.population.fitness[0], evaluate(trees))
    best = [float(state.population.fitness.max()) for state in found]
    assert best == sorted(best)
    assert best[-1] > best[0]


def test_the_same_seed_gives_the_same_run(single):
    _, found = single
    _, again = states()
    _, other = states(dataclasses.replace(CONFIG, seed=1))
    assert_same([state.population for state in found], [state.population for state in again])
    assert not np.array_equal(found[-1].population.trees.tokens, other[-1].population.trees.tokens)


@pytest.mark.parametrize("generation", [0, 3, 5])
def test_going_on_equals_never_stopping(single, generation):
    evolution, found = single
    copy = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)), found[generation].population)
    state = dataclasses.replace(found[generation], population=copy)
    fresh = Evolution(CONFIG, ALPHABET, evaluate)
    rest = list(fresh.run(state))
    assert len(rest) == 7 - generation
    for ours, theirs in zip(rest, found[generation:], strict=True):
        assert_same(ours.population, theirs.population)
        assert_same(ours.seen, theirs.seen)
        assert fresh.describe(ours) == evolution.describe(theirs)


@pytest.mark.slow
def test_runs_are_single_runs_of_the_next_seeds(single):
    evolution, found = single
    together, several = states(dataclasses.replace(CONFIG, runs=2))
    following, other = states(dataclasses.replace(CONFIG, seed=1))
    for run, alone, own in ((0, found, evolution), (1, other, following)):
        for ours, theirs in zip(several, alone, strict=True):
            own_part, whole = (
                jax.tree.map(lambda leaf, r=r: leaf[r], s.population) for r, s in ((run, ours), (0, theirs))
            )
            assert_same(own_part, whole)
            row = together.describe(ours)[run]
            assert dataclasses.replace(row, run=0) == own.describe(theirs)[0]


def achieve(trees: Trees) -> tuple[np.ndarray, np.ndarray]:
    return evaluate(trees), (np.asarray(trees.tokens) == GOOD).any(axis=-1).astype(np.int32)


def niched(config):
    evolution = Evolution(config, ALPHABET, achieve)
    return evolution, list(evolution.run())


def test_niches_keep_what_selection_by_fitness_would_lose():
    _, found = niched(dataclasses.replace(CONFIG, population=32, niches=True))
    _, plain = states(dataclasses.replace(CONFIG, population=32))
    for state in found:
        fitness, achieved = achieve(state.population.trees)
        nodes = np.asarray(state.population.trees.sizes)[..., 0]
        np.testing.assert_array_equal(state.population.fitness, fitness)
        np.testing.assert_array_equal(state.population.niche, achieved * (CONFIG.max_nodes + 1) + nodes)
    best = [float(state.population.fitness.max()) for state in found]
    assert best == sorted(best)
    kinds = [len(np.unique(np.asarray(achieve(states_[-1].population.trees)[1]))) for states_ in (plain, found)]
    sizes = [len(np.unique(np.asarray(states_[-1].population.trees.sizes)[..., 0])) for states_ in (plain, found)]
    assert kinds[1] == 2
    assert sizes[1] > sizes[0]


def test_with_niches_going_on_equals_never_stopping_and_runs_are_single_runs():
    config = dataclasses.replace(CONFIG, niches=True, generations=4)
    evolution, found = niched(dataclasses.replace(config, runs=2))
    for ours, theirs in zip(evolution.run(found[2]), found[2:], strict=True):
        assert_same((ours.population, ours.seen), (theirs.population, theirs.seen))
    for run in range(2):
        _, alone = niched(dataclasses.replace(config, seed=run))
        for ours, theirs in zip(found, alone, strict=True):
            part, whole = (jax.tree.map(lambda x, i=i: x[i], s.population) for i, s in ((run, ours), (0, theirs)))
            assert_same(part, whole)


def test_with_niches_the_baseline_stays_among_the_parents():
    config = dataclasses.replace(CONFIG, niches=True)
    _, found = niched(config)
    baseline = best_of(found[-1])[0][0]
    evolution = Evolution(config, ALPHABET, achieve, baseline=baseline)
    for state in evolution.run():
        trees = jax.tree.map(lambda leaf: leaf[0], state.population.trees)
        assert is_valid(trees, ALPHABET, gene_under_fallback=False).all()
        assert float(state.population.fitness.max()) >= evaluate(baseline)


def test_rows_say_what_happened(single):
    _, found = single
    evolution = Evolution(CONFIG, ALPHABET, evaluate, episodes_per_tree=3)
    rows = [evolution.describe(state)[0] for state in found]
    assert [row.generation for row in rows] == list(range(7))
    assert rows[0].episodes == 3 * len({row.tobytes() for row in np.asarray(found[0].population.trees.tokens[0])})
    assert rows[-1].episodes <= 3 * (8 + 6 * CONFIG.num_offspring)
    assert (np.diff([row.episodes for row in rows]) > 0).all()
    fitness = np.asarray(found[-1].population.fitness)
    trees, best = best_of(found[-1])
    assert rows[-1].best == best[0] == fitness.max()
    assert rows[-1].mean == pytest.approx(fitness.mean())
    assert rows[-1].std == pytest.approx(fitness.std())
    assert rows[-1].nodes == trees.sizes[0, 0]
    assert evaluate(trees) == best


def test_it_stops_at_the_target_or_when_time_is_up(single):
    evolution, found = single
    target = float(found[2].population.fitness.max())
    first = next(i for i, state in enumerate(found) if float(state.population.fitness.max()) >= target)
    assert [state.generation for state in evolution.run(target=target)] == list(range(first + 1))
    assert [state.generation for state in evolution.run(time_limit=0.0)] == [0]


def test_the_baseline_is_there_from_the_start_and_stays(single):
    _, found = single
    baseline = best_of(found[-1])[0][0]
    _, states_ = states(baseline=baseline)
    assert_same(jax.tree.map(lambda leaf: leaf[0, 0], states_[0].population.trees), baseline)
    assert all(float(state.population.fitness.max()) >= evaluate(baseline) for state in states_)
    assert_same(states_[0].baseline_fitness, evaluate(baseline)[None])


def test_an_individual_without_a_number_does_not_win():
    def sometimes(trees):
        fitness = evaluate(trees)
        return np.where(np.asarray(trees.tokens)[..., 1] % 3 == 0, np.float32(WORST_FITNESS), fitness)

    evolution = Evolution(CONFIG, ALPHABET, sometimes)
    found = list(evolution.run())
    assert any((np.asarray(state.population.fitness) == WORST_FITNESS).any() for state in found)
    assert best_of(found[-1])[1][0] > -1000
    assert all(np.isfinite(row.mean) for state in found for row in evolution.describe(state))


def test_settings_that_cannot_work_are_refused():
    with pytest.raises(UserError, match="population is 3"):
        Evolution(dataclasses.replace(CONFIG, population=3), ALPHABET, evaluate)
    with pytest.raises(UserError, match="no tree can be made"):
        Evolution(CONFIG, Alphabet(num_conditions=1, num_actions=0, num_genes=0), evaluate)


def test_a_fitness_is_one_finite_number_for_each_tree(single):
    _, found = single
    evolution, trees = Evolution(CONFIG, ALPHABET), found[0].population.trees
    fitness = np.asarray(evaluate(trees))
    for same in (fitness.astype(np.float64), jnp.asarray(fitness)):
        assert_same(evolution.tell(None, trees, same).population, evolution.tell(None, trees, fitness).population)
    with pytest.raises(ValueError, match="one value for each tree"):
        evolution.tell(None, trees, fitness[:, 1:])
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match="not finite"):
            evolution.tell(None, trees, np.where(fitness == fitness.max(), bad, fitness))


def test_asking_and_telling_is_the_same_evolution(single):
    _, found = single
    evolution = Evolution(CONFIG, ALPHABET)
    state = None
    for expected in found:
        offspring = evolution.ask(state)
        state = evolution.tell(state, offspring, evaluate(offspring))
        assert_same((state.population, state.seen), (expected.population, expected.seen))
    with pytest.raises(ValueError, match="give it one, or use ask and tell"):
        evolution.step(state)
