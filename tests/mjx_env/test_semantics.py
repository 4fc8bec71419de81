import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from py_trees.common import Status as Theirs

from bt_jax._util.errors import UserError
from bt_jax.behaviors import FIRST_LEAF, NOTHING, Behavior, Kind, Vocabulary, subgoal_conditions
from bt_jax.behaviors.geometry import is_at, is_clear, is_in_reach, taken_by
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.tick import Status
from bt_jax.mjx_env.conditions import holding_subgoals
from bt_jax.mjx_env.outcomes import COMMAND_BITS, SUBGOAL_BITS
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import poses_by_name, rotate
from bt_jax.tasks import load_task
from tests.helpers.samples import PARTS, kinematic_walk, one, semantics_of

THEIRS = {Status.SUCCESS: Theirs.SUCCESS, Status.FAILURE: Theirs.FAILURE, Status.RUNNING: Theirs.RUNNING}


class Oracle:
    """One state, asked in words of the design."""

    def __init__(self, task, world):
        self.task = task
        self.poses, self.kit = world.poses[0].astype(float), world.kits[0, 0].astype(float)
        self.held, self.gripper_open, self.reached = int(world.held[0]), bool(world.gripper_open[0]), world.reached[0]

    def index(self, name):
        return self.task.object_names.index(name)

    def frame(self, name):
        upright = np.array([1.0, 0, 0, 0])
        if name == self.task.kits[0].name:
            return self.kit, upright
        if name == self.task.robot_frame:
            return np.array(self.task.robot_position), upright
        pose = self.poses[self.index(name)]
        return pose[:3], pose[3:]

    def holds(self, c):
        match c.name:
            case "at":
                origin, turn = self.frame(c.frame)
                goal = origin + rotate(turn[None].astype(np.float32), np.array([c.position], np.float32))[0]
                close = np.linalg.norm(self.poses[self.index(c.object), :3] - goal) < self.task.episode.tolerance
                return close and self.held != self.index(c.object)
            case "holding":
                return self.held == (-1 if c.object == NOTHING else self.index(c.object))
            case "gripper":
                return self.gripper_open == (c.args[0] == "open")
            case "reachable":
                return self.poses[self.index(c.object), 2] > 0.7
            case "clear":
                return not any(self.rests(i, self.index(c.object)) for i in range(len(self.poses)))
            case "reached":
                return self.is_reached(c.args[0]) or (self.ticked and self.shows(c.args[0]))
        raise AssertionError(c)

    @property
    def ticked(self):
        return self.task.subgoal_reward == "ticked"

    def is_reached(self, subgoal):
        return bool(self.reached[[g.name for g in self.task.subgoals].index(subgoal)])

    def shows(self, subgoal):
        return all(map(self.holds, subgoal_conditions(self.task)[subgoal]))

    def bits(self, atoms):
        """The subgoals that count as reached once a tree has ticked these atoms."""
        asked = {atom.args[0] for atom in atoms if atom.name == "reached"}
        new = [self.ticked and g.name in asked and not self.is_reached(g.name) and self.shows(g.name)
               for g in self.task.subgoals]  # fmt: skip
        return sum(1 << i for i, is_new in enumerate(new) if is_new)

    def rests(self, above, below):
        if above == below or self.held in (above, below):
            return False
        offset = self.poses[above, :3] - self.poses[below, :3]
        return 0.06 < offset[2] < 0.13 and np.abs(offset[:2]).max() < 0.1

    def status(self, leaf):
        if leaf.kind == Kind.CONDITION:
            return Status.SUCCESS if self.holds(leaf) else Status.FAILURE
        if all(map(self.holds, leaf.postconditions)):
            return Status.SUCCESS
        return Status.RUNNING if all(map(self.holds, leaf.preconditions)) else Status.FAILURE


class ScalarOracle(Oracle):
    """One state with parts and turns, asked of the scalar reference."""

    def __init__(self, task, world):
        super().__init__(task, world)
        self.named = poses_by_name(world, task)
        self.in_hand = task.object_names[self.held] if self.held >= 0 else None

    def holds(self, c):
        return any(self.holds_for(c, name) for name in self.task.instances.get(c.object, [None]))

    def holds_for(self, c, name):
        match c.name:
            case "at":
                one, pose, frame = self.task.thing(name), self.named[name], self.named[c.frame]
                free = name not in (self.in_hand, c.frame)
                return free and is_at(one, pose, frame, c.position, turn=c.turn, episode=self.task.episode)
            case "holding":
                return self.in_hand == name
            case "reachable":
                return is_in_reach(self.task, self.named, name)
            case "clear":
                return is_clear(self.task, self.named, name, held=self.in_hand)
        return super().holds(c)

    def status(self, leaf):
        found = super().status(leaf)
        if found == Status.RUNNING and leaf.name == "pick":
            can = taken_by(self.task, self.named, leaf.object, held=self.in_hand) is not None
            return Status.RUNNING if can else Status.FAILURE
        if found == Status.RUNNING and leaf.name == "place" and leaf.frame == self.in_hand:
            return Status.FAILURE
        return found


def expected_outcome(leaf, status_of, oracle, commands):
    """Outcome and status of a leaf: py_trees ticks its subtree, and the command is the action that runs."""
    running, ticked = [], []

    def tick_leaf(atom):
        status = status_of(atom)
        ticked.append(atom)
        if status == Status.RUNNING:
            running.append(atom)
        return THEIRS[status]

    root = to_py_trees(leaf, tick_leaf, expand_genes=True)
    root.tick_once()
    status = next(ours for ours, theirs in THEIRS.items() if theirs == root.status)
    command = commands.index(running[-1]) if status == Status.RUNNING else 0
    return oracle.bits(ticked) << SUBGOAL_BITS | command << COMMAND_BITS | status, status, running[-1:]


def stem(value):
    return Path(value).stem


walked = functools.cache(kinematic_walk)


@given(st.sampled_from(["stack3", "restack", PARTS]), st.sets(st.integers(0, 200)))
def test_selected_leaves_return_the_same(task_name, chosen):
    semantics, world, _ = walked(task_name, seed=3)
    tokens = np.array(sorted(token for token in chosen if FIRST_LEAF <= token < len(semantics.vocabulary)), int)
    selection = semantics.select(tokens)
    np.testing.assert_array_equal(selection.tokens, [*range(FIRST_LEAF), *tokens])
    expected = semantics.outcomes(world)[:, :, selection.tokens]
    np.testing.assert_array_equal(semantics.outcomes(world, selection), expected)


@pytest.mark.parametrize(
    ("name", "rule"), [("stack3", "seen"), ("restack", "seen"), ("restack", "ticked"), (PARTS, "seen")], ids=stem
)
def test_outcomes_are_those_of_py_trees_on_every_leaf(name, rule):
    semantics, worlds, _ = kinematic_walk(name, seed=3, count=6, steps=8, subgoal_reward=rule)
    outcomes = semantics.outcomes(worlds)
    met = set()
    ask = ScalarOracle if semantics.has_parts else Oracle
    holding, free = (np.flatnonzero((worlds.held >= 0) == held) for held in (True, False))
    for s in (*holding[-3:], *free[-5:])[:: 2 if semantics.has_parts else 1]:
        oracle = ask(semantics.task, one(worlds, s))
        for i, leaf in enumerate(semantics.vocabulary.leaves):
            first, status, failed = expected_outcome(leaf, oracle.status, oracle, semantics.commands)
            assert outcomes[0, s, FIRST_LEAF + i] == first, (s, str(leaf))

            def exhausted(atom, oracle=oracle, failed=failed):
                return Status.FAILURE if atom in failed else oracle.status(atom)

            second, _, _ = expected_outcome(leaf, exhausted, oracle, semantics.commands)
            assert outcomes[1, s, FIRST_LEAF + i] == second, (s, str(leaf))
            met.add((leaf.name, status))
            met.update([leaf.name] if first >> SUBGOAL_BITS else [])
    for action in ("open_gripper", "close_gripper", "pick", "place", "move"):
        assert (action, Status.RUNNING) in met
    for action in ("open_gripper", "close_gripper", "pick"):
        assert (action, Status.SUCCESS) in met
    assert ({"reached", "subtask"} <= met) == bool(semantics.num_ticked)


@pytest.mark.parametrize("name", ["stack3", "restack", "yumi_stack", PARTS], ids=stem)
def test_numpy_and_jax_agree(name):
    semantics, worlds, _ = kinematic_walk(name, seed=4)
    found = semantics.outcomes(worlds)
    assert found.dtype == np.int32
    as_jax = jax.jit(semantics.outcomes)(jax.tree.map(jnp.asarray, worlds))
    np.testing.assert_array_equal(as_jax, found)


def test_the_subgoal_is_seen_once_and_for_all():
    _, worlds, _ = kinematic_walk("restack", seed=5, count=30, steps=12, subgoal_reward="seen")
    reached = worlds.reached.reshape(13, 30)
    assert not reached[0].any()
    assert reached[-1].any()
    assert not reached[-1].all()
    assert (np.diff(reached.astype(int), axis=0) >= 0).all()


def test_a_subgoal_that_has_to_be_ticked_is_not_reached_by_itself():
    semantics, worlds, _ = kinematic_walk("restack", seed=5, count=30, steps=12)
    assert semantics.task.subgoal_reward == "ticked"
    assert not worlds.reached.any()
    assert holding_subgoals(semantics.task, worlds).any()


def test_a_stack_is_not_clear_and_not_unstacked():
    task = load_task("restack")
    semantics = semantics_of("restack")
    conditions = semantics._atom_outcomes(sample_layouts(task, 0, 5)) == Status.SUCCESS
    clear = [semantics.conditions.index(Behavior("clear", (name,))) for name in task.layout.stack]
    np.testing.assert_array_equal(conditions[:, clear], np.tile([False, False, True], (5, 1)))


def test_leaves_that_the_task_does_not_know_are_refused():
    task = load_task("stack")
    with pytest.raises(UserError, match="RedBox"):
        LeafSemantics(task, Vocabulary.of([Behavior("pick", ("RedBox",))]))
    with pytest.raises(UserError, match="subgoal"):
        LeafSemantics(task, Vocabulary.of([Behavior("reached", ("unstacked",))]))
