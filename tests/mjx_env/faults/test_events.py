import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bt_jax.behaviors import gene_pool
from bt_jax.mjx_env.faults.events import (
    ALL_SEEN,
    SPOTS,
    brings,
    hides,
    is_away,
    moves,
    num_person_events,
    num_sight_events,
    person_acts,
    sight_changes,
    takes,
)
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.predicates import is_clear, reachable
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, world_keys
from bt_jax.tasks import load_task, with_faults
from bt_jax.tasks.faults import PRESETS
from tests.helpers.samples import PARTS, walk


@functools.cache
def walked(task_name):
    task = with_faults(load_task(task_name), PRESETS["harsh"])
    semantics = LeafSemantics(task, gene_pool(task))
    return task, walk(semantics, Kinematic(task), seed=1, count=12, steps=6)[0]


def events(world, number):
    return np.full(len(world.held), number, np.int32)


@pytest.mark.parametrize("task_name", ["stack3", PARTS, "yumi_kit4"])
def test_a_person_takes_an_object_away_and_brings_it_back(task_name):
    task, world = walked(task_name)
    for thing in range(len(task.objects)):
        can = (world.held != thing) & is_clear(world, task)[:, thing]
        gone = person_acts(world, task, events(world, takes(task, thing)))
        np.testing.assert_array_equal(is_away(gone, task)[:, thing], can)
        assert not reachable(gone, task)[can, thing].any()
        assert gone.unseen[can, thing].all()
        seen = sight_changes(gone, task, events(world, ALL_SEEN))
        np.testing.assert_array_equal(seen.unseen, is_away(seen, task))
        back = person_acts(gone, task, events(world, brings(task, thing, thing % SPOTS)))
        assert not is_away(back, task).any()
        assert not back.unseen[:, thing].any()
        assert reachable(back, task)[can, thing].all()
        assert is_clear(back, task)[can, thing].all()
        others = np.arange(len(task.objects)) != thing
        np.testing.assert_array_equal(back.poses[:, others], world.poses[:, others])
        np.testing.assert_array_equal(back.poses[~can], world.poses[~can])


@pytest.mark.parametrize("task_name", ["stack3", PARTS, "yumi_kit4"])
def test_what_a_person_moves_stands_free_and_stays_there(task_name):
    task, world = walked(task_name)
    physics = Kinematic(task)
    for thing in range(len(task.objects)):
        moved = person_acts(world, task, events(world, moves(task, thing, 2 * thing % SPOTS)))
        can = (world.held != thing) & is_clear(world, task)[:, thing] & ~is_away(world, task)[:, thing]
        changed = (moved.poses != world.poses).any(axis=(1, 2))
        assert not changed[~can].any()
        assert changed[can].mean() > 0.9
        present = moved.held[:, None] != np.arange(len(task.objects))
        rest = np.asarray(physics.settle(moved.kits, moved.poses, present).poses)
        np.testing.assert_allclose(rest[changed, thing], moved.poses[changed, thing], atol=2e-4)
        for row in np.flatnonzero(changed):
            near = np.linalg.norm(moved.poses[row, :, :2] - moved.poses[row, thing, :2], axis=1)
            least = [thing_.reach + task.objects[thing].reach for thing_ in task.objects]
            apart = (
                (near > np.array(least)) | (np.arange(len(near)) == thing) | (np.arange(len(near)) == moved.held[row])
            )
            assert apart.all()


def test_nothing_happens_in_most_ticks():
    task, world = walked("stack3")
    for act in (person_acts, sight_changes):
        np.testing.assert_array_equal(world_keys(act(world, task, events(world, 0))), world_keys(world))


def test_one_object_is_out_of_sight_until_all_are_seen():
    task, world = walked("stack3")
    for thing in range(3):
        hidden = sight_changes(world, task, events(world, hides(thing)))
        np.testing.assert_array_equal(hidden.unseen, np.tile(np.arange(3) == thing, (len(world.held), 1)))
        assert not sight_changes(hidden, task, events(world, ALL_SEEN)).unseen.any()


def test_jax_does_the_same():
    task, world = walked(PARTS)
    rng = np.random.default_rng(0)
    person = rng.integers(num_person_events(task), size=len(world.held)).astype(np.int32)
    sight = rng.integers(num_sight_events(task), size=len(world.held)).astype(np.int32)

    def both(world, person, sight):
        return sight_changes(person_acts(world, task, person), task, sight)

    ours, theirs = both(world, person, sight), jax.jit(both)(*jax.tree.map(jnp.asarray, (world, person, sight)))
    np.testing.assert_array_equal(world_keys(ours), world_keys(jax.device_get(theirs)))
    assert isinstance(ours, World)
    assert dataclasses.is_dataclass(theirs)
