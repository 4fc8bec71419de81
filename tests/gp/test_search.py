"""The search as a whole, in a domain without boxes."""

import dataclasses

import jax
import numpy as np
import pytest

from bt_jax.behaviors import Control
from bt_jax.encoding.arrays import decode, encode
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.procedure import best_of
from bt_jax.gp.search import AchievementSearch
from bt_jax.gp.validity import is_valid
from tests.helpers.samples import assert_same
from tests.helpers.tower import Tower

CONFIG = GPConfig(max_nodes=24, seed=3)


def search_in(tower, config=CONFIG, **options):
    return AchievementSearch(config, tower.vocabulary.kinds, tower.goals, tower.measured, **options)


@pytest.fixture(scope="module")
def found():
    return list(search_in(Tower()).run())


@pytest.mark.parametrize(
    "tower", [pytest.param(Tower(), marks=pytest.mark.slow), Tower(right=(2, 2), step=True)], ids=str
)
def test_every_offspring_is_valid_and_none_is_measured_twice(tower):
    search, state = search_in(tower), None
    alphabet = Alphabet.of(tower.vocabulary)
    for generation in range(15):
        offspring = search.ask(state)
        assert is_valid(jax.tree.map(lambda leaf: leaf[0], offspring), alphabet).all()
        state = search.tell(state, offspring, tower.measured(offspring))
        assert state.trees_measured == [CONFIG.population * (generation + 1)]
        assert is_valid(state.knowledge[0].archive.trees, alphabet).all()


@pytest.mark.parametrize("step", [False, True])
def test_it_finds_the_smallest_tree_and_stops_once_nothing_improves(step):
    tower = Tower(step=step)
    *_, state = search_in(tower).run()
    assert state.knowledge[0].solved
    assert state.generation < CONFIG.num_generations
    assert state.knowledge[0].stagnant == CONFIG.num_patience
    tree, fitness = best_of(state)
    text = one_line(decode(tree[0], tower.vocabulary))
    if not step:
        assert text == "Sequence(0@4, 1@1, 2@3)"
    assert float(fitness[0]) == pytest.approx(float(tower.measured(tree[None]).fitness[0, 0]))


def test_the_same_seed_gives_the_same_run_from_any_state_on(found):
    asked = []

    def confirm(run, trees):
        asked.append(run)
        return jax.tree.map(lambda leaf: leaf[0], Tower().measured(trees[None]))

    search = search_in(Tower(), confirm=confirm)  # whose trees do as well in other layouts
    assert_same([state.knowledge for state in found], [state.knowledge for state in search.run()])
    assert asked == [0]
    middle = found[len(found) // 2]
    assert_same([state.population for state in search.run(middle)], [s.population for s in found[len(found) // 2 :]])
    other = search_in(Tower(), dataclasses.replace(CONFIG, seed=4)).step(None)
    assert not np.array_equal(found[0].population.trees.tokens, other.population.trees.tokens)


@pytest.mark.slow
def test_run_r_of_several_is_the_single_run_of_seed_plus_r():
    several = dataclasses.replace(CONFIG, runs=2, generations=4)
    *_, both = search_in(Tower(), several).run()
    for run in range(2):
        *_, single = search_in(Tower(), dataclasses.replace(several, runs=1, seed=CONFIG.seed + run)).run()
        assert_same(both.knowledge[run], single.knowledge[0])


def test_the_search_knows_targets_only_from_what_episodes_return():
    """Told the same, it asks for the same, wherever the targets are."""
    one, other = search_in(Tower(right=(4, 1, 3))), search_in(Tower(right=(1, 3, 4)))
    state = same = None
    for _ in range(12):
        offspring = one.ask(state)
        assert_same(offspring, other.ask(same))
        measured = Tower(right=(4, 1, 3)).measured(offspring)
        state, same = one.tell(state, offspring, measured), other.tell(same, offspring, measured)


def test_the_baseline_is_measured_first_and_can_be_the_best():
    tower = Tower()
    tree = encode(decode_text(tower, "Sequence(0@4, 1@1, 2@3)"), tower.vocabulary, CONFIG.max_nodes)
    state = search_in(tower, baseline=tree).step(None)
    np.testing.assert_array_equal(best_of(state)[0].tokens[0], tree.tokens)
    assert float(state.baseline_fitness[0]) == float(best_of(state)[1][0])


def elsewhere(tower):
    """What a run asks to try its best trees in more layouts, where blocks belong as `tower` says."""
    return lambda run, trees: jax.tree.map(lambda leaf: leaf[0], tower.measured(trees[None]))


def test_a_baseline_that_does_in_all_layouts_is_kept_as_it_is():
    tower = Tower()
    whole = encode(decode_text(tower, "Sequence(0@4, 1@1, 2@3, unlock)"), tower.vocabulary, CONFIG.max_nodes)
    config = dataclasses.replace(CONFIG, accept_baseline=True, runs=2)
    search = search_in(tower, config, baseline=whole, confirm=elsewhere(tower))
    (state,) = search.run()  # nothing is bred
    assert state.generation == 0
    for run in range(2):
        np.testing.assert_array_equal(best_of(state)[0].tokens[run], whole.tokens)  # with what is of no use here
    more = dataclasses.replace(config, generations=1)
    assert len(list(search_in(tower, more, baseline=whole, confirm=elsewhere(tower)).run(state))) == 2


@pytest.mark.parametrize("text", ["Sequence(0@4, 1@1, 2@3)", "Sequence(0@4, 1@1, 2@2)"])
def test_a_baseline_that_fails_in_some_layout_is_only_where_evolution_begins(text):
    tower, other = Tower(), Tower(right=(4, 1, 5))
    tree = encode(decode_text(tower, text), tower.vocabulary, CONFIG.max_nodes)
    config = dataclasses.replace(CONFIG, accept_baseline=True)
    state = search_in(tower, config, baseline=tree, confirm=elsewhere(other)).step(None)
    plain = search_in(tower, CONFIG, baseline=tree, confirm=elsewhere(other)).step(None)
    assert_same((state.knowledge, state.population), (plain.knowledge, plain.population))


def decode_text(tower, text):
    names = {leaf.name: leaf for leaf in tower.vocabulary.leaves}
    return Control.sequence(*(names[name] for name in text[len("Sequence(") : -1].split(", ")))


def test_what_a_state_hands_on_achieves_the_most(found):
    search = search_in(Tower())
    trees = search.kept(found[-1])
    assert trees.tokens.shape == (1, CONFIG.population, CONFIG.max_nodes)
    state = search.adopt(trees, generation=7, earlier=[40])
    assert state.generation == 7
    assert state.knowledge[0].solved
    assert state.trees_measured[0] > 40


def test_a_baseline_that_joins_later_is_measured_in_place_of_the_last_tree(found):
    tower = Tower()
    tree = encode(decode_text(tower, "Sequence(0@0, 1@1)"), tower.vocabulary, CONFIG.max_nodes)
    search = search_in(tower, baseline=tree)
    kept = search.kept(found[-1])
    state = search.adopt(kept, generation=7, earlier=[40])
    expected = tower.measured(jax.tree.map(lambda leaf: np.asarray(leaf)[None, None], tree)).fitness[0, 0]
    assert float(state.baseline_fitness[0]) == expected < tower.measured(kept).fitness.max()
    assert state.knowledge[0].solved
    best, _ = best_of(state)
    np.testing.assert_array_equal(best.tokens, best_of(found[-1])[0].tokens)


def test_a_fitness_that_is_not_finite_is_refused():
    search = search_in(Tower())
    offspring = search.ask(None)
    measured = Tower().measured(offspring)
    measured.fitness[0, 0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        search.tell(None, offspring, measured)


def test_history_tells_what_was_learnt(found):
    search = search_in(Tower())
    first, last = (search.describe(state)[0] for state in (found[0], found[-1]))
    assert 0 < first.kept <= last.kept
    assert (last.achieved, last.understood) == (3, 3)
    assert last.episodes == CONFIG.population * len(found)


def text_of(tower, tree):
    return one_line(decode(tree, tower.vocabulary))


@pytest.mark.parametrize("runs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_tree_that_fails_in_other_layouts_does_not_end_the_search(runs):
    """Block 0 may lie in either of two places, but elsewhere only in one of them."""
    tower, asked = Tower(near=((0, 0, 0.0),)), []

    def confirm(run, trees):
        asked.append(run)
        return jax.tree.map(lambda leaf: leaf[0], Tower(right=(0, 1, 3)).measured(trees[None]))

    config = dataclasses.replace(CONFIG, runs=runs)
    *_, state = search_in(tower, config, confirm=confirm).run()
    assert state.generation < CONFIG.num_generations
    assert set(asked) == set(range(runs))
    trees, _ = best_of(state)
    for run in range(runs):
        assert state.knowledge[run].solved
        assert text_of(tower, trees[run]) == "Sequence(0@0, 1@1, 2@3)"


def test_what_costs_fitness_in_a_solved_tree_is_refined():
    """A place beside the right one will do, but the right one is better; and a leaf that does nothing goes."""
    tower = Tower(near=((1, 2, 5.0),))
    *_, state = search_in(tower).run()
    assert text_of(tower, best_of(state)[0][0]) == "Sequence(0@4, 1@1, 2@3)"
