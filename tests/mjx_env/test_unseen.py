"""Objects out of sight: unknown is never true."""

import dataclasses
import functools

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, Kind
from bt_jax.encoding.tick import Status
from bt_jax.mjx_env.outcomes import command_of
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act
from bt_jax.tasks import Faults, load_task, with_faults
from tests.helpers.samples import PARTS, assert_same, kinematic_walk

walked = functools.cache(functools.partial(kinematic_walk, seed=3, count=10))


def without(world, *, hidden):
    return dataclasses.replace(world, unseen=np.tile(hidden, (len(world.held), 1)))


def names(task, atom):
    """The objects that an atom concerns: those that it stands for, and its frame."""
    if atom.name == "holding":
        return set()  # the gripper feels it
    return {*task.instances.get(atom.object, ()), *([atom.frame] if atom.frame in task.object_names else [])}


def atoms(semantics):
    return [*semantics.conditions, *semantics.commands]


@settings(max_examples=8)
@given(st.sampled_from(["stack3", PARTS]), st.data())
def test_what_does_not_name_a_hidden_object_stays_as_it_is_and_nothing_that_does_starts(task_name, data):
    semantics, world, _ = walked(task_name)
    task = semantics.task
    hidden = np.array(data.draw(st.lists(st.booleans(), min_size=len(task.objects), max_size=len(task.objects))))
    seen = semantics._atom_outcomes(world)
    unseen = semantics._atom_outcomes(without(world, hidden=hidden))
    lost = hidden & (world.held[:, None] != np.arange(len(hidden)))
    for column, atom in enumerate(atoms(semantics)):
        own = np.array([name in names(task, atom) for name in task.object_names])
        touched = (lost & own).any(axis=1)
        before, after = seen[:, column], unseen[:, column]
        np.testing.assert_array_equal(before[~touched], after[~touched])
        if atom.kind == Kind.CONDITION:
            assert ((after & 3 == Status.SUCCESS) <= (before & 3 == Status.SUCCESS)).all(), "unknown is never true"
        names_one = len(task.instances.get(atom.object, ())) <= 1
        if names_one and atom.name in ("at", "reachable", "clear"):
            assert (after[touched] & 3 == Status.FAILURE).all()
        if names_one and atom.name in ("pick", "place"):
            holds = (world.held[:, None] == np.flatnonzero(own)).any(axis=1) & (atom.name == "pick")
            assert (after[touched & ~holds] & 3 == Status.FAILURE).all()


@settings(max_examples=4)
@given(st.data())
def test_a_part_is_taken_from_the_instances_in_sight(data):
    semantics, world, _ = walked(PARTS)
    task = semantics.task
    part = data.draw(st.sampled_from([name for name in task.kinds if name not in task.object_names]))
    hidden = np.array([name in task.instances[part] for name in task.object_names])
    column = len(semantics.conditions) + 2 + semantics.names.index(part)
    outcome = semantics._atom_outcomes(without(world, hidden=hidden))[:, column]
    assert (outcome & 3 != Status.RUNNING).all()


def test_jax_says_the_same():
    semantics, world, _ = walked("stack3")
    hidden = np.random.default_rng(0).random((len(world.held), len(semantics.task.objects))) < 0.4
    world = dataclasses.replace(world, unseen=hidden)
    ours = jax.jit(semantics.outcomes)(jax.tree.map(jax.numpy.asarray, world))
    np.testing.assert_array_equal(semantics.outcomes(world), np.asarray(ours))


@pytest.mark.parametrize("task_name", ["stack3", PARTS])
def test_looking_lasts_until_the_object_is_seen_and_moves_nothing(task_name):
    walked_semantics, world, _ = walked(task_name)
    task = walked_semantics.task
    leaves = [Behavior(kind, (name,)) for name in task.kinds for kind in ("look", "is_seen")]
    semantics = LeafSemantics(task, walked_semantics.vocabulary.extended(leaves))
    hidden = np.random.default_rng(1).random((len(world.held), len(task.objects))) < 0.6
    world = dataclasses.replace(world, unseen=hidden)
    outcomes = semantics.outcomes(world)
    for name in task.kinds:
        own = [i for i, one in enumerate(task.object_names) if one in task.instances[name]]
        seen = (~hidden[:, own] | (world.held[:, None] == np.array(own))).any(axis=1)
        looked, asked = (
            outcomes[:, :, semantics.vocabulary.token(Behavior(kind, (name,)))] for kind in ("look", "is_seen")
        )
        np.testing.assert_array_equal(asked, np.tile(np.where(seen, Status.SUCCESS, Status.FAILURE), (2, 1)))
        np.testing.assert_array_equal(looked[0] & 3, np.where(seen, Status.SUCCESS, Status.RUNNING))
        np.testing.assert_array_equal(looked[1] & 3, np.where(seen, Status.SUCCESS, Status.FAILURE))
        command = semantics.commands.index(Behavior("look", (name,)))
        assert (command_of(looked[0][~seen]) == command).all()
        released = act(semantics, world, np.full(len(world.held), command, np.int32))
        assert_same(released.world, world)
        assert (released.box == -1).all()
    everything = dataclasses.replace(world, unseen=None)
    assert (
        semantics.outcomes(everything)[:, :, [semantics.vocabulary.token(leaf) for leaf in leaves]] == Status.SUCCESS
    ).all()
    before = walked_semantics.outcomes(everything)
    tokens = [semantics.vocabulary.token(leaf) for leaf in walked_semantics.vocabulary.leaves]
    np.testing.assert_array_equal(semantics.outcomes(everything)[..., tokens] & 3, before[..., 3:] & 3)


def test_layouts_of_a_task_with_faults_begin_with_everything_in_sight():
    task = load_task("stack")
    assert sample_layouts(task, 0, 2).unseen is None
    changed = sample_layouts(with_faults(task, Faults(slip=0.1)), 0, 2)
    assert not changed.unseen.any()
    np.testing.assert_array_equal(changed.poses, sample_layouts(task, 0, 2).poses)
