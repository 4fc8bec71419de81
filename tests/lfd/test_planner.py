import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, expand, parse_behavior
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.lfd.evaluation.synthetic import random_truth, with_boxes
from bt_jax.lfd.planner import MAX_DEPTH, fold_moves, plan, plan_task
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.tasks import load_task
from tests.helpers.demonstrations import RESTACK, STACK3, STACKING, UNSTACKING, at, run

GOAL = [at(one.object, one.position, one.frame) for one in STACKING]
ASIDE = [at(one.object, one.position, one.frame) for one in UNSTACKING]
CYCLE = [at("YellowBox", (0.12, 0, 0), "BlueBox"), at("BlueBox", (0.12, 0, 0), "YellowBox")]


def random_goal(seed, *, boxes):
    """Where boxes may stand together: the last place of each in a random truth."""
    task = with_boxes(STACK3, boxes)
    truth = {one.object: one for one in random_truth(task, rng=np.random.default_rng(seed))}
    return task, [at(one.object, one.position, one.frame) for one in truth.values()]


def holds(condition, world, task):
    """Oracle in the world's coordinates; all frames have the world's axes here."""
    centre = {name: world.poses[0, i, :3] for i, name in enumerate(task.object_names)}
    centre |= {task.kits[0].name: world.kits[0, 0], task.robot_frame: np.array(task.robot_position)}
    distance = np.linalg.norm(centre[condition.object] - centre[condition.frame] - condition.position)
    return distance < task.episode.tolerance


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), boxes=st.integers(2, 6))
def test_planned_trees_reach_random_goals(seed, boxes):
    task, goal = random_goal(seed, boxes=boxes)
    tree = plan(goal)
    assert violations(tree) == []
    assert violations(expand(tree)) == []
    played = run(tree, task, seed=seed)
    assert played.ending == Ending.SUCCESS
    for condition in goal:
        assert holds(condition, played.final, task)
    # Each box is moved once.
    assert len([tick for tick in played.ticks if tick.command is not None]) <= 2 * len(goal)


@given(seed=st.integers(0, 10**6), boxes=st.integers(2, 6), data=st.data())
def test_plans_are_deterministic_and_free_of_the_order_of_their_goal(seed, boxes, data):
    _, goal = random_goal(seed, boxes=boxes)
    shuffled = data.draw(st.permutations(goal))
    tree = plan(goal)
    assert plan(list(goal)) == tree
    parts = {str(part) for part in (tree.children if isinstance(tree, Control) and len(goal) > 1 else [tree])}
    again = plan(shuffled)
    assert {str(part) for part in (again.children if len(goal) > 1 else [again])} == parts


@pytest.mark.parametrize("goal", [*itertools.permutations(GOAL)])
def test_a_frame_is_placed_before_what_stands_in_it(goal):
    moves = [Behavior("move", condition.args) for condition in GOAL]
    assert plan(goal) == Control.sequence(*moves)


@pytest.mark.parametrize("name", ["stack", "stack3", "pyramid"])
def test_tasks_are_solved_by_planning(name):
    task = load_task(name)
    for seed in range(5):
        assert run(plan_task(task), task, seed=seed, max_ticks=15).solved


def test_what_stands_on_a_box_is_in_the_way():
    """Nothing in the targets says that the stack has to be taken apart; preconditions do."""
    assert run(plan(GOAL), RESTACK).ending == Ending.FAILURE
    extra = {
        Behavior("place", ASIDE[1].args): (ASIDE[0],),
        Behavior("place", GOAL[0].args): tuple(ASIDE),
    }
    tree = plan(GOAL, extra=extra)
    assert violations(tree) == []
    for seed in range(5):
        assert run(tree, RESTACK, seed=seed, max_ticks=15).solved


def test_the_backchained_form():
    folded = plan([GOAL[0]], extra={Behavior("place", GOAL[0].args): (parse_behavior("holding(BlueBox)"),)})
    assert isinstance(folded, Control)
    assert plan([parse_behavior("holding(BlueBox)")]) == parse_tree(
        "Fallback(holding(BlueBox), Sequence(Fallback(gripper(open), open_gripper), pick(BlueBox)))"
    )
    assert plan([parse_behavior("gripper(closed)")]) == parse_tree("Fallback(gripper(closed), close_gripper)")
    assert plan([GOAL[0]]) == Behavior("move", GOAL[0].args)


def test_the_gripper_is_free_after_a_placement():
    nothing = parse_behavior("holding(nothing)")
    assert plan([nothing, *GOAL]) == plan(GOAL)
    assert plan([nothing]) == parse_tree("Fallback(holding(nothing), open_gripper)")


def test_the_cheapest_action_is_taken_the_first_of_equals():
    opened = parse_behavior("gripper(open)")
    assert plan([opened], actions=[Behavior("pick", ("BlueBox",))]) == plan([opened])
    assert plan([parse_behavior("holding(nothing)")]).children[1] == Behavior("open_gripper")


@given(seed=st.integers(0, 10**6))
@example(seed=0)
def test_moves_are_folded(seed):
    _, goal = random_goal(seed, boxes=4)
    tree = plan(goal)
    assert fold_moves(expand(tree)) == tree
    assert fold_moves(tree) == tree


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ([], "there is nothing to achieve; give a goal"),
        (CYCLE, r"each of at\(YellowBox.*undoes another; give one of them another frame"),
        ([parse_behavior("clear(BlueBox)")], r"no action achieves clear\(BlueBox\); leave it out"),
        ([parse_behavior("reached(unstacked)")], r"no action achieves reached\(unstacked\); leave it out"),
    ],
)
def test_what_cannot_be_planned_is_said(goal, message):
    with pytest.raises(UserError, match=message):
        plan(goal)


def test_conditions_that_need_each_other_are_named():
    extra = {Behavior("place", GOAL[0].args): (GOAL[1],), Behavior("place", GOAL[1].args): (GOAL[0],)}
    with pytest.raises(
        UserError, match=r"cannot be planned: at\(Yellow.* needs at\(Green.* needs at\(Yellow.*; change"
    ):
        plan(GOAL[:1], extra=extra)


def test_plans_are_bounded():
    places = [at("BlueBox", (0, 0, 0.1 * i), "KittingBox") for i in range(1, MAX_DEPTH + 3)]
    chain = {Behavior("place", a.args): (b,) for a, b in itertools.pairwise(places)}
    with pytest.raises(UserError, match="conditions deep; demonstrate smaller subtasks"):
        plan(places[:1], extra=chain)


def test_leaves_of_plans_are_conditions_actions_and_moves():
    extra = {Behavior("place", GOAL[0].args): tuple(ASIDE)}
    stack, kinds = [plan([GOAL[0], parse_behavior("holding(GreenBox)")], extra=extra)], set()
    while stack:
        node = stack.pop()
        kinds.add(node.kind)
        stack += node.children if isinstance(node, Control) else ()
    assert kinds == {Kind.SEQUENCE, Kind.FALLBACK, Kind.CONDITION, Kind.ACTION, Kind.GENE}
