import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bt_jax.encoding.status import Status
from bt_jax.mjx_env.episodes.rules import NO_COMMAND, Ending, count_tick, fresh_tally, is_solved, used_up
from bt_jax.tasks import load_task
from tests.helpers.samples import assert_same

RULES = dataclasses.replace(load_task("stack").episode, max_ticks=4, success_ticks=2, action_ticks=2)
S, F, R = Status.SUCCESS, Status.FAILURE, Status.RUNNING


def run(statuses, commands=None, broken=None):
    """Tally of one episode after these ticks."""
    tally = fresh_tally(1)
    for i, status in enumerate(statuses):
        command = commands[i] if commands else 0
        sick = bool(broken and broken[i])
        tally = count_tick(tally, np.array([status], np.int8), np.array([command], np.int32), np.array([sick]), RULES)
    return tally


@pytest.mark.parametrize(
    ("statuses", "ending", "ticks"),
    [
        ([F], Ending.FAILURE, 1),
        ([S], Ending.OPEN, 1),
        ([S, S], Ending.SUCCESS, 2),
        ([S, R, S], Ending.OPEN, 3),
        ([R, R, R, R], Ending.TIMEOUT, 4),
        ([R, R, S, S], Ending.SUCCESS, 4),  # in the last tick
        ([R, R, R, F], Ending.FAILURE, 4),
        ([S, S, F, F], Ending.SUCCESS, 2),  # what has ended stays as it is
    ],
)
def test_when_an_episode_ends(statuses, ending, ticks):
    tally = run(statuses)
    assert (tally.ending[0], tally.ticks[0]) == (ending, ticks)


def test_a_simulation_that_diverges_ends_the_episode_only_if_its_command_ran():
    assert run([R], broken=[True]).ending[0] == Ending.BROKEN
    assert run([S], broken=[True]).ending[0] == Ending.OPEN


def test_an_action_uses_up_its_ticks_in_a_row():
    assert used_up(run([R, R], [3, 3]), RULES)[0] == 3
    assert used_up(run([R, R], [3, 4]), RULES)[0] == NO_COMMAND
    assert used_up(run([R, S], [3, 3]), RULES)[0] == NO_COMMAND


def test_numpy_and_jax_agree():
    rng = np.random.default_rng(0)
    host = fresh_tally(200)
    device = jax.tree.map(jnp.asarray, host)
    step = jax.jit(count_tick, static_argnames=("rules",))
    for _ in range(4):
        status = rng.choice([S, R, R, F], 200).astype(np.int8)
        command, broken = rng.integers(0, 2, 200).astype(np.int32), rng.random(200) < 0.1
        host, device = count_tick(host, status, command, broken, RULES), step(device, status, command, broken, RULES)
        assert_same(host, device)


def test_solved_means_success_with_every_target_near():
    distance = np.array([[0.01, 0.02], [0.01, 0.04], [0.01, 0.02]], np.float32)
    ending = np.array([Ending.SUCCESS, Ending.SUCCESS, Ending.TIMEOUT], np.int8)
    np.testing.assert_array_equal(is_solved(ending, distance < RULES.tolerance), [True, False, False])
