"""Rollouts on every level give the episodes that the table gives, and an episode that diverges costs no other one."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.faults.fates import sample_fates
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.protocol import AtOnce, CompiledPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import load_task, with_faults
from bt_jax.tasks.faults import FAULTS, PRESETS
from tests.helpers.samples import SometimesBroken, assert_same, mixed_trees, semantics_of

NODES, COUNT, LAYOUTS = 32, 60, 3


def episodes(task_name, count=COUNT):
    semantics = semantics_of(task_name)
    return semantics, mixed_trees(semantics, 10, count, NODES), sample_layouts(semantics.task, 5, LAYOUTS)


@pytest.mark.parametrize(
    "task_name", ["stack3", *(pytest.param(name, marks=pytest.mark.slow) for name in ("restack", "mobile_stack"))]
)
def test_rollouts_in_the_c_engine_are_those_of_the_table(task_name):
    semantics, trees, layouts = episodes(task_name)
    physics = make_physics(semantics.task, "mujoco")
    evaluators = [kind(semantics, physics, batch=COUNT, trace=True) for kind in (TableEvaluator, RolloutEvaluator)]
    by_table, by_rollout = (evaluate(trees, layouts) for evaluate in evaluators)
    assert_same(by_table, by_rollout)
    assert set(by_table.ending.ravel()) == {Ending.SUCCESS, Ending.FAILURE, Ending.TIMEOUT}


@pytest.mark.slow
def test_rollouts_in_mjx_are_those_of_the_table():
    """But for what the table simulates without the objects that take no part."""
    semantics, trees, layouts = episodes("stack3", 20)
    physics = make_physics(semantics.task, "mjx")
    evaluators = [kind(semantics, physics, batch=20) for kind in (TableEvaluator, RolloutEvaluator)]
    by_table, by_rollout = (evaluate(trees, layouts) for evaluate in evaluators)
    same = (by_table.ending == by_rollout.ending) & (by_table.solved == by_rollout.solved)
    assert np.mean(same & (np.abs(by_table.values - by_rollout.values) < 5)) > 0.98


def test_of_a_large_vocabulary_only_the_leaves_in_use_are_computed(monkeypatch):
    semantics, trees, layouts = episodes("stack3", 12)
    physics = make_physics(semantics.task, "mujoco")
    expected = RolloutEvaluator(semantics, physics, batch=12)(trees, layouts)
    monkeypatch.setattr("bt_jax.mjx_env.episodes.rollout_host.FEW_TOKENS", 0)
    asked = []
    monkeypatch.setattr(type(semantics), "outcomes", _watched(type(semantics).outcomes, asked))
    assert_same(RolloutEvaluator(semantics, physics, batch=12)(trees, layouts), expected)
    assert {tuple(tokens) for tokens in asked} == {tuple(np.unique([0, 1, 2, *trees.tokens.ravel()]))}


def _watched(outcomes, asked):
    def watched(self, world, selection):
        asked.append(selection.tokens)
        return outcomes(self, world, selection)

    return watched


@dataclasses.dataclass(frozen=True)
class Slow(AtOnce):
    """Problems that take very different numbers of steps, in few lanes."""

    lanes: int = 7

    def begin(self, kits, poses, present):
        return super().begin(kits, poses, present), (jnp.abs(poses[:, 0, 0]) * 97).astype(jnp.int32) % 20

    def step(self, motion):
        return motion[0], motion[1] - 1

    def rests(self, motion):
        return motion[1] <= 0

    def settled(self, motion):
        """Wrong while it moves."""
        early = ~self.rests(motion)
        return dataclasses.replace(motion[0], poses=motion[0].poses + jnp.where(early, 1.0, 0.0)[:, None, None])


@dataclasses.dataclass(frozen=True)
class InLanes(SometimesBroken):
    """Physics that diverges now and then, in a compiled loop."""

    @property
    def stepper(self):
        return Slow(self.settle)


class OnHost:
    """The same physics, which no compiled loop can call."""

    name, description = "host", "a test"

    def __init__(self, task):
        self.settle = SometimesBroken(task).settle


@pytest.mark.parametrize("level", [OnHost, InLanes])
def test_no_episode_is_lost_or_held_up_and_one_that_diverges_costs_no_other(level):
    semantics, trees, layouts = episodes("stack3")
    evaluator = RolloutEvaluator(semantics, level(semantics.task), batch=COUNT, trace=True)
    found = evaluator(trees, layouts)
    assert_same(
        found, TableEvaluator(semantics, SometimesBroken(semantics.task), batch=COUNT, trace=True)(trees, layouts)
    )
    assert set(found.ending.ravel()) == {Ending.SUCCESS, Ending.FAILURE, Ending.TIMEOUT, Ending.BROKEN}
    assert evaluator.num_broken == np.sum(found.ending == Ending.BROKEN)
    assert isinstance(level(semantics.task), CompiledPhysics) == (level is InLanes)


def harsh(continuous):
    task = with_faults(
        load_task("stack3"), dataclasses.replace(PRESETS["harsh"], drop=0.1, move=0.05, take=0.1, heavy=0.2)
    )
    semantics = LeafSemantics(task, semantics_of("stack3").vocabulary)
    fates = sample_fates(task, 5, layouts=LAYOUTS, draws=1, continuous=continuous)
    return semantics, mixed_trees(semantics, 10, COUNT, NODES), sample_layouts(task, 5, LAYOUTS), fates


def test_rollouts_follow_the_fates_that_the_table_follows():
    semantics, trees, layouts, fates = harsh(continuous=False)
    physics = make_physics(semantics.task, "mujoco")
    evaluators = [kind(semantics, physics, batch=COUNT) for kind in (TableEvaluator, RolloutEvaluator)]
    by_table, by_rollout = (evaluate(trees, layouts, None, fates) for evaluate in evaluators)
    assert_same(by_table, by_rollout)
    calm = evaluators[1](trees, layouts)
    assert np.mean(by_rollout.values == calm.values) < 0.6
    assert (calm.struck == 0).all()
    assert np.bitwise_or.reduce(by_rollout.struck, axis=None) == (1 << len(FAULTS)) - 1


@pytest.mark.slow
def test_chance_is_the_same_on_the_host_and_in_a_compiled_loop():
    """But for the last digit of sines and cosines, which may decide to which side something falls."""
    semantics, trees, layouts, fates = harsh(continuous=True)
    levels = OnHost(semantics.task), InLanes(semantics.task)
    host, compiled = (RolloutEvaluator(semantics, level, batch=COUNT)(trees, layouts, None, fates) for level in levels)
    same = (host.ending == compiled.ending) & (host.struck == compiled.struck)
    assert np.mean(same & (np.abs(host.values - compiled.values) < 1)) > 0.98


@pytest.mark.parametrize("backend", ["mujoco", pytest.param("mjx", marks=pytest.mark.slow)])
def test_a_state_that_is_no_number_costs_its_episode_and_is_counted(backend):
    """As in one lane of the batch, whatever made it so."""
    semantics, trees, layouts = episodes("stack3", 12)
    physics = make_physics(semantics.task, backend)
    poses = layouts.poses.copy()
    poses[1, :, 0] = np.nan
    evaluator = RolloutEvaluator(semantics, physics, batch=12)
    found = evaluator(trees, dataclasses.replace(layouts, poses=poses))
    assert evaluator.num_broken == (found.ending == Ending.BROKEN).sum() > 0
    whole = np.array([0, 2])
    expected = RolloutEvaluator(semantics, physics, batch=12)(trees, layouts)
    np.testing.assert_array_equal(found.values[:, whole], expected.values[:, whole])
