"""A task that is not at a robot's scale is refused before anything is planned or simulated."""

import dataclasses

import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.planning.feasibility import check_scale, load_share
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.tasks import load_task
from tests.helpers.six_axis import SIX_AXIS

TASK = load_task("yumi_stack")


@pytest.mark.parametrize("robot", [YUMI, SIX_AXIS])
def test_a_task_at_the_scale_of_a_robot_is_taken(robot):
    check_scale(robot, TASK)


@pytest.mark.parametrize("used", [check_scale, cell_rules, lambda robot, task: build_scene(robot, task, 0)])
@pytest.mark.parametrize("name", ["stack", "stack3", "pyramid", "restack"])
def test_tasks_of_a_larger_robot_are_refused(used, name):
    with pytest.raises(UserError, match=f"of task {name} is 100 mm wide, .* open 50 mm; .* yumi_stack"):
        used(YUMI, load_task(name))


@pytest.mark.parametrize("position", [(1.5, 0.0, -0.05), (0.3, 0.9, -0.05), (0.3, 0.0, -0.2), (0.75, -0.75, -0.05)])
def test_a_table_out_of_reach_is_refused(position):
    tables = (*TASK.tables[:2], dataclasses.replace(TASK.tables[2], position=position))
    with pytest.raises(UserError, match="TableRight of task yumi_stack is out of the reach of yumi"):
        check_scale(YUMI, dataclasses.replace(TASK, tables=tables))


def test_where_the_robot_stands_counts():
    moved = dataclasses.replace(TASK, robot_position=(3.0, 0.0, 0.0))
    with pytest.raises(UserError, match="out of the reach"):
        check_scale(YUMI, moved)


def test_no_arm_carries_more_than_it_may():
    assert load_share(YUMI, TASK) == pytest.approx((0.24 + 0.064) / 0.5)
    for mass in (0.45, -1.0, float("nan"), float("inf")):
        with pytest.raises(UserError, match="the 500 g that the left arm may carry"):
            load_share(YUMI, TASK, mass)
