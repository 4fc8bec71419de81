"""Training where things go wrong: draws of chance in every layout, and a test that says what they did."""

import dataclasses
import json

import numpy as np
import pytest

from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Faults, load_faults, load_task, with_faults
from bt_jax.training import result
from bt_jax.training.console import failures_met, faults_met, where_tested
from bt_jax.training.result import Failures
from bt_jax.training.run_config import RunConfig
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training
from tests.helpers.samples import assert_same

TASK = with_faults(load_task("stack"), dataclasses.replace(load_faults("harsh"), hide=0.0, take=0.0))
CONFIG = GPConfig(population=8, generations=1)
QUICK = Settings(level="kinematic", layouts=2, draws=3, test_layouts=6)
SOLUTION = "Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))"


@pytest.fixture(scope="module")
def training():
    return Training(TASK, CONFIG, QUICK)


def test_every_tree_meets_the_same_fates_which_follow_from_the_configuration(training):
    assert training.layouts.held.shape == (6,)
    assert training.fates.person.shape == (6, TASK.episode.max_ticks)
    again = Training.of(training.run_config)
    assert_same(again.fates, training.fates)
    other = Training(TASK, dataclasses.replace(CONFIG, seed=1), QUICK)
    assert (other.fates.variant != training.fates.variant).any()


def test_the_test_counts_what_went_wrong(training):
    test = training.test(parse_tree(SOLUTION))
    assert test.solved.shape == (18,)
    assert test.draws == 3
    assert test.success_rate > 0.5
    for solved, episodes in test.by_fault.values():
        assert 0 <= solved <= episodes <= 18
    assert "slip" in test.by_fault
    low, high = test.interval
    assert low <= test.success_rate <= high


def test_a_configuration_keeps_faults_and_draws(training, tmp_path):
    config = dataclasses.replace(training.run_config, settings=dataclasses.replace(QUICK, robust=0.2))
    assert RunConfig.of(json.loads(config.to_json()), tmp_path) == config


def test_robust_fitness_is_that_of_the_worst_episodes(training):
    trees = training.evolution.ask(None)
    flat = trees[0]
    found = training.evaluator(flat, training.layouts, fates=training.fates)
    np.testing.assert_allclose(found.lower_mean(0.3), np.sort(found.values, axis=1)[:, :2].mean(axis=1), rtol=1e-6)
    np.testing.assert_array_equal(found.lower_mean(1.0), found.fitness)
    assert (found.lower_mean(0.2) <= found.fitness + 1e-3).all()


def test_a_test_is_told_with_interval_faults_and_the_three_commonest_ways_of_failing():
    reasons = tuple(Failures(f"reason {i}", tuple(range(1, 6 - i)), tuple(range(1, 6 - i))) for i in range(5))
    struck = np.zeros(50, np.int32)
    struck[:10] = 2
    solved = np.arange(50) > 8
    test = result.Test(solved, np.zeros(50, np.float32), reasons, draws=5, struck=struck)
    assert where_tested(test) == "episodes in unseen layouts (95 %: 69.2 to 90.2 %)"
    assert faults_met(test) == "faults       drops: 1 of 10\n"
    lines = failures_met(test).splitlines()
    assert lines[0] == "failures     5: reason 0 (layout.draw 1.1, 2.2, 3.3, 4.4, 5.5)"
    assert len(lines) == 4
    assert lines[3].strip() == "3: for other reasons"


def test_without_faults_there_are_no_draws():
    task = load_task("stack")
    assert Settings(layouts=3).episodes(task) == 3
    assert Settings(layouts=3).episodes(with_faults(task, Faults(slip=0.1))) == 15
