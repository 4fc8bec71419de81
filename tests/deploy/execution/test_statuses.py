import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import Behavior, Kind, expand
from bt_jax.deploy.execution.statuses import Context, Statuses, subgoals_by_sight
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.conditions import holding_subgoals
from bt_jax.mjx_env.outcomes import command_of
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task
from tests.helpers.ideal import observe
from tests.helpers.samples import kinematic_walk, one


def test_the_simulation_means_the_same_by_every_leaf():
    semantics, worlds, _ = kinematic_walk("yumi_stack", seed=3, count=4, steps=6)
    outcomes = semantics.outcomes(worlds)[0]
    found = set()
    for i in range(len(outcomes)):
        seen = observe(semantics.task, one(worlds, i))
        for leaf in semantics.vocabulary.leaves:
            tree = expand(leaf)
            ticked = tick_tree(tree, Statuses(semantics.task, seen, Context()))
            outcome = outcomes[i, semantics.vocabulary.token(leaf)]
            assert ticked.status == outcome & 3, (leaf, seen)
            if ticked.running is not None:
                assert prefix(tree)[ticked.running] == semantics.commands[command_of(outcome)]
            found.add((leaf.name, ticked.status))
    assert {status for name, status in found if name == "move"} == set(Status)


def test_subgoals_are_those_of_the_simulation():
    semantics, worlds, _ = kinematic_walk("restack", seed=4, count=20, steps=8)
    ticked, seen = semantics.task, dataclasses.replace(semantics.task, subgoal_reward="seen")
    expected = holding_subgoals(ticked, worlds)[:, 0]
    assert len(set(expected)) == 2
    for i, holds in enumerate(expected):
        view = observe(ticked, one(worlds, i))
        assert subgoals_by_sight(seen, view) == ({"unstacked"} if holds else set())
        assert subgoals_by_sight(ticked, view) == set()


def test_a_subgoal_that_has_to_be_ticked_counts_from_the_tick_in_which_it_holds():
    semantics, worlds, _ = kinematic_walk("restack", seed=4, count=20, steps=8)
    task, reached = semantics.task, Behavior("reached", ("unstacked",))
    for i, holds in enumerate(holding_subgoals(task, worlds)[:, 0]):
        view = observe(task, one(worlds, i))
        statuses = Statuses(task, view, Context())
        assert (statuses(reached, 0) == Status.SUCCESS) == holds == ("unstacked" in statuses.ticked)
        later = Statuses(task, view, Context(reached=frozenset(["unstacked"])))
        assert later(reached, 0) == Status.SUCCESS
        assert not later.ticked
        by_sight = Statuses(dataclasses.replace(task, subgoal_reward="seen"), view, Context())
        assert by_sight(reached, 0) == Status.FAILURE
        assert not by_sight.ticked


def test_nothing_unknown_is_true():
    task = load_task("stack3")
    start = sample_layouts(task, 0, 1)
    for unknown in ("YellowBox", "KittingBox"):
        seen = observe(task, start, unknown=(unknown,))
        statuses = Statuses(task, seen, Context())
        at = Behavior("at", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox"))
        assert statuses(at, 0) == Status.FAILURE
        assert statuses.undecided == [at]
    seen = observe(task, start, unknown=("YellowBox",))
    for name in ("reachable", "clear", "pick"):
        statuses = Statuses(task, seen, Context())
        assert statuses(Behavior(name, ("YellowBox",)), 0) == Status.FAILURE
        assert statuses.undecided


def test_a_box_in_the_hand_is_known_to_be_nowhere_else():
    task = load_task("stack3")
    seen = observe(task, sample_layouts(task, 0, 1), unknown=("YellowBox",))
    seen = dataclasses.replace(seen, holding="YellowBox", opening={"left": 0.1, "right": 0.2})
    place = Behavior("place", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox"))
    statuses = Statuses(task, seen, Context())
    assert statuses(Behavior("at", place.args), 0) == Status.FAILURE
    assert statuses(Behavior("holding", ("YellowBox",)), 0) == Status.SUCCESS
    assert statuses(place, 0) == Status.RUNNING
    assert statuses(Behavior("gripper", ("open",)), 0) == Status.FAILURE
    assert not statuses.undecided


def test_an_attempt_goes_on_while_its_object_is_hidden_but_not_against_what_is_seen():
    task = load_task("stack3")
    start = sample_layouts(task, 0, 1)
    pick = Behavior("pick", ("YellowBox",))
    hidden = observe(task, start, unknown=("YellowBox",))
    assert Statuses(task, hidden, Context(attempt=pick))(pick, 0) == Status.RUNNING
    seen = observe(task, start)
    on_top = seen.poses["YellowBox"] * RigidTransform.from_translation([0, 0, 0.1])
    covered = dataclasses.replace(seen, poses={**seen.poses, "GreenBox": on_top})
    assert Statuses(task, covered, Context(attempt=pick))(pick, 0) == Status.FAILURE
    place = Behavior("place", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox"))
    assert Statuses(task, seen, Context(attempt=place))(place, 0) == Status.FAILURE, "the box was dropped"


def test_a_box_on_which_something_out_of_sight_may_stand_is_looked_at_first():
    task = load_task("stack3")
    start = observe(task, sample_layouts(task, 0, 1))
    hidden = observe(task, sample_layouts(task, 0, 1), unknown=("GreenBox",))
    on_top = start.poses["YellowBox"] * RigidTransform.from_translation([0, 0, 0.1])
    never = {name: pose for name, pose in start.poses.items() if name != "GreenBox"}
    clear = Behavior("clear", ("YellowBox",))

    def doubted(seen, last):
        statuses = Statuses(task, seen, Context(last=last))
        statuses.holds(clear)
        return statuses.undecided == [clear]

    assert doubted(hidden, {**start.poses, "GreenBox": on_top})
    assert doubted(hidden, never)
    assert not doubted(hidden, start.poses), "it is known to be elsewhere"
    assert not doubted(start, {**start.poses, "GreenBox": on_top}), "it is seen elsewhere"
    held = dataclasses.replace(hidden, holding="GreenBox")
    assert not doubted(held, {**start.poses, "GreenBox": on_top}), "it is in the hand"


def test_what_was_tried_too_often_or_is_out_of_reach_fails():
    task = load_task("stack3")
    seen = observe(task, sample_layouts(task, 0, 1))
    pick = Behavior("pick", ("YellowBox",))
    assert Statuses(task, seen, Context())(pick, 0) == Status.RUNNING
    assert Statuses(task, seen, Context(exhausted=frozenset([pick])))(pick, 0) == Status.FAILURE
    assert Statuses(task, seen, Context(unreachable=frozenset(["YellowBox"])))(pick, 0) == Status.FAILURE


def test_the_robots_frame_is_where_the_robot_is():
    task = load_task("stack3")
    seen = observe(task, sample_layouts(task, 0, 1))
    position = tuple(float(x) for x in seen.poses["BlueBox"].translation)
    statuses = Statuses(task, seen, Context())
    assert statuses(Behavior("at", ("BlueBox", position, task.robot_frame)), 0) == Status.SUCCESS
    away = tuple(np.add(position, [0, 0, 0.05]))
    assert statuses(Behavior("at", ("BlueBox", away, task.robot_frame)), 0) == Status.FAILURE


def test_every_kind_of_leaf_is_known_to_the_executor():
    from bt_jax.behaviors import SIGNATURES

    task = load_task("restack")
    seen = observe(task, sample_layouts(task, 0, 1))
    values = {
        "object": "YellowBox",
        "position": (0.0, 0.0, 0.1),
        "frame": "BlueBox",
        "opening": "open",
        "subgoal": "unstacked",
    }
    for name, signature in SIGNATURES.items():
        if signature.kind != Kind.GENE:
            leaf = Behavior(name, tuple(values[argument] for argument in signature.arguments))
            assert Statuses(task, seen, Context())(leaf, 0) in Status
