"""What is planned is admitted by the rules of the same robot."""

import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.safety import check_trajectory
from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task


@pytest.mark.parametrize("seed", range(8))
def test_paths_as_they_are_timed_keep_the_speeds_and_accelerations_of_the_rules(seed):
    rules = cell_rules(YUMI, load_task("yumi_stack"))
    rules = dataclasses.replace(rules, points=None, clearance_of=None)
    rng, arm = np.random.default_rng(seed), YUMI.arms[seed % 2]
    path = rng.uniform(0.5 * arm.lower, 0.5 * arm.upper, (int(rng.integers(2, 5)), len(arm.joints)))
    for pace in (Pace(), Pace(share=1.0), Pace().slowed(0.3)):
        trajectory = timed(path, pace, arm)
        check_trajectory(rules, arm.name, trajectory, commanded=path[0], others={}, clearance=None)
