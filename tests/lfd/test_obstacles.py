"""What stands in the way is put out of it: generated tasks with random stacks and random towers as targets."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, placing_gene
from bt_jax.behaviors.geometry import rests_on
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.walk import leaves
from bt_jax.lfd.evaluation.random_tasks import random_task
from bt_jax.lfd.evaluation.synthetic import with_boxes
from bt_jax.lfd.extents import block_at
from bt_jax.lfd.obstacles import Obstacles
from bt_jax.lfd.placements import condition_of
from bt_jax.lfd.planner import plan, plan_task
from bt_jax.lfd.starts import above, fills, may_fill
from bt_jax.mjx_env.conditions import holding_subgoals
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import frames, poses_by_name, to_world
from bt_jax.tasks import Layout, Target, load_task, task_names
from tests.helpers.demonstrations import RESTACK, STACK3, asides, playbacks

seeds = st.integers(0, 10**6)


def generated(seed):
    rng = np.random.default_rng(seed)
    return random_task(STACK3, boxes=int(rng.integers(2, 6)), rng=rng)


def in_world(task, world, place):
    """What a box fills at a place in one layout."""
    index = np.array([task.frames.index(place.frame)])
    centre = to_world(frames(world, task), index, np.array([place.position], np.float32))[0, 0]
    return block_at(tuple(map(float, centre)), task.thing(place.object).half_at(None))


def at_start(task, world, name):
    return block_at(
        tuple(map(float, world.poses[0, task.object_names.index(name), :3])), task.thing(name).half_at(None)
    )


@settings(max_examples=8)
@given(seed=seeds)
def test_plans_solve_random_tasks(seed):
    task = generated(seed)
    tree = plan_task(task)
    assert violations(tree, gene_under_fallback=False) == []
    assert plan_task(task) == tree
    (played,) = playbacks(tree, task, seed=seed, count=1)
    assert played.solved
    assert bool(played.final.reached.all())


@pytest.mark.parametrize("name", task_names())
def test_every_packaged_task_is_solved_by_its_plan(name):
    task = load_task(name)
    for played in playbacks(plan_task(task), task, seed=1, count=2):
        assert played.solved


@pytest.mark.parametrize("name", [name for name in task_names() if name != "restack"])
def test_where_nothing_is_in_the_way_a_plan_only_moves_boxes_to_their_targets(name):
    gene = placing_gene(load_task(name))
    moves = [Behavior(gene, condition_of(target).args) for target in load_task(name).targets]
    assert plan_task(load_task(name)) == Control.sequence(*moves)


@pytest.mark.parametrize("rule", ["seen", "ticked"])
def test_a_plan_reaches_the_subgoals_by_either_rule(rule):
    task = dataclasses.replace(RESTACK, subgoal_reward=rule)
    for played in playbacks(plan_task(task), task, seed=2, count=5):
        assert played.solved
        assert bool(played.final.reached.all())


def test_a_subgoal_that_holds_from_the_start_is_only_ticked():
    task = dataclasses.replace(STACK3, subgoals=RESTACK.subgoals)
    moves = plan_task(STACK3).children
    assert plan_task(task) == Control.sequence(Behavior("reached", ("unstacked",)), *moves)
    assert plan_task(dataclasses.replace(task, subgoal_reward="seen")) == Control.sequence(*moves)
    assert holding_subgoals(task, sample_layouts(task, 0, 20)).all()


def test_without_subgoals_the_stack_is_taken_apart_on_the_way_to_the_first_target():
    tree = plan_task(dataclasses.replace(RESTACK, subgoals=()))
    first, *others = tree.children
    assert str(first.children[0]).startswith("at(YellowBox")
    assert [leaf.object for leaf in leaves(first.children[1])] == ["GreenBox", "BlueBox", "YellowBox"]
    assert others == [Behavior("move", condition_of(target).args) for target in RESTACK.targets[1:]]


@pytest.mark.parametrize("stack", list(itertools.permutations(RESTACK.layout.stack)))
def test_no_box_is_put_aside_twice_to_restack_it(stack):
    layout = dataclasses.replace(RESTACK.layout, stack=stack)
    task = dataclasses.replace(RESTACK, layout=layout, subgoals=())
    moves = [str(leaf) for leaf in leaves(plan_task(task)) if leaf.name == "move"]
    assert len(moves) == len(set(moves))
    (played,) = playbacks(plan_task(task), task, seed=7, count=1)
    assert played.solved


def test_a_stack_whose_boxes_have_separate_places_is_taken_down_from_the_top():
    cells = [(-0.133, 0.0, 0.0525), (0.0, 0.0, 0.0525), (0.133, 0.0, 0.0525)]
    targets = [Target(name, cell, "KittingBox") for name, cell in zip(RESTACK.layout.stack, cells, strict=True)]
    task = dataclasses.replace(RESTACK, targets=tuple(targets), subgoals=())
    moves = [Behavior("move", condition_of(target).args) for target in reversed(targets)]
    assert plan_task(task) == Control.sequence(*moves)


def test_boxes_that_change_places():
    places = [(-1.1, -1.0, 0.75), (-0.9, -1.0, 0.75)]
    fixed = [Target(name, place, "base_link") for name, place in zip(("YellowBox", "GreenBox"), places, strict=True)]
    goal = [Target(name, place, "base_link") for name, place in zip(("GreenBox", "YellowBox"), places, strict=True)]
    layout = Layout(kit="TableRight", fixed=tuple(fixed), margin=0.2)
    task = dataclasses.replace(STACK3, layout=layout, targets=tuple(goal))
    assert len(asides(task)) >= 1
    for played in playbacks(plan_task(task), task, seed=3, count=5):
        assert played.solved


def test_a_target_below_another_is_filled_first_in_whatever_order_they_are_listed():
    task = load_task("pyramid")
    top_first = dataclasses.replace(task, targets=task.targets[::-1])
    assert plan_task(top_first).children[-1].object == "GreenBox"
    for played in playbacks(plan_task(top_first), top_first, seed=4, count=5):
        assert played.solved


def test_what_may_be_in_the_way_stays_if_there_are_too_few_ticks():
    """A box somewhere on the table where another should be: it is moved, unless the episode is too short for that."""
    task = dataclasses.replace(STACK3, targets=(Target("GreenBox", (-1.0, -1.0, 0.75), "base_link"),))
    task = dataclasses.replace(task, layout=dataclasses.replace(task.layout, kit="TableRight"))
    assert {place.object for place in asides(task)} == {"YellowBox", "BlueBox"}
    for played in playbacks(plan_task(task), task, seed=5, count=10):
        assert played.solved
    hasty = dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=7))
    assert asides(hasty) == []


def test_where_no_place_is_free_it_is_said():
    table = dataclasses.replace(RESTACK.tables[0], size=(0.41, 0.41, 0.75))
    tables = [dataclasses.replace(table, name=one.name, position=one.position) for one in RESTACK.tables]
    genes = dataclasses.replace(RESTACK.genes, grid=1)
    task = dataclasses.replace(RESTACK, tables=tuple(tables), genes=genes)
    with pytest.raises(
        UserError, match=r"task restack: no place is free in all layouts to put \w+ out of the way; make"
    ):
        plan_task(task)


@settings(max_examples=10)
@given(seed=seeds)
def test_free_places_are_free_in_every_layout(seed):
    task = generated(seed)
    places = asides(task)
    for layout in range(3):
        world = sample_layouts(task, [seed, layout], 1)
        for place in places:
            filled = in_world(task, world, place)
            others = [at_start(task, world, name) for name in task.object_names if name != place.object]
            others += [in_world(task, world, other) for other in places if other != place]
            for other in others:
                assert filled.gap(other) > task.genes.gap - 1e-3


@settings(max_examples=10)
@given(seed=seeds)
def test_what_stands_on_a_box_and_fills_a_place_in_a_layout_is_foreseen(seed):
    task = generated(seed)
    for layout in range(3):
        world = sample_layouts(task, [seed, layout], 1)
        starts = {name: at_start(task, world, name) for name in task.object_names}
        poses = poses_by_name(world, task)
        for name in task.object_names:
            direct = {
                other
                for other in task.object_names
                if other != name and rests_on(task.thing(other), poses[other], task.thing(name), poses[name])
            }
            assert direct <= above(task, name)
            assert bool(direct) == bool(above(task, name))
        for target in task.targets:
            if target.frame in [other.object for other in task.targets]:
                continue  # its frame is moved before it
            goal = in_world(task, world, target)
            for name in set(task.object_names) - {target.object}:
                filled = starts[name].gap(goal) < -2e-3 and starts[name].top > goal.bottom + 2e-3
                assert not filled or may_fill(task, name, target)
                assert filled or not fills(task, name, target)


def test_what_a_subgoal_needs_are_its_own_conditions_and_free_places():
    unstacked = Obstacles(RESTACK).needed(Behavior("reached", ("unstacked",)))
    assert [condition.object for condition in unstacked] == ["GreenBox", "BlueBox"]
    clear = Obstacles(RESTACK).needed(Behavior("clear", ("YellowBox",)))
    assert clear == unstacked
    assert Obstacles(STACK3).needed(Behavior("clear", ("YellowBox",))) == ()


def test_a_box_is_cleared_by_moving_what_is_on_it():
    cleared = Obstacles(RESTACK).needed(Behavior("clear", ("YellowBox",)))
    tree = plan([Behavior("clear", ("YellowBox",))], obstacles=Obstacles(RESTACK))
    assert tree == Control.sequence(*(Behavior("move", condition.args) for condition in cleared))
    played, *_ = playbacks(tree, RESTACK, seed=6, count=1)
    assert played.final.held.tolist() == [-1]
    assert len(played.ticks) == 2 * len(cleared) + RESTACK.episode.success_ticks


def test_boxes_beyond_those_of_a_task_make_no_difference_to_a_plan():
    stack = tuple(with_boxes(STACK3, 5).object_names[3:])
    task = with_boxes(STACK3, 5)
    other = dataclasses.replace(task, layout=dataclasses.replace(task.layout, stack=stack))
    assert plan_task(other) == plan_task(STACK3)


def test_obstacles_are_none_of_a_goal_without_a_task():
    goal = [condition_of(target) for target in RESTACK.targets]
    assert plan(goal) == Control.sequence(*(Behavior("move", condition.args) for condition in goal))
