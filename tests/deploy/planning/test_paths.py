import numpy as np
import pytest

from bt_jax.deploy.planning.paths import connect, densified
from bt_jax.deploy.robot.yumi import YUMI

ARM = YUMI.arm("left")


@pytest.mark.parametrize("seed", range(5))
def test_ways_around_an_obstacle_are_free(seed):
    centre = np.full(7, 0.1)

    def free(joints):
        return bool(np.linalg.norm(joints - centre) > 0.3)

    start, goal = np.full(7, -0.3), np.full(7, 0.5)
    path = connect(start, goal, free, ARM, seed=seed)
    np.testing.assert_array_equal(path[[0, -1]], np.stack([start, goal]))
    assert all(free(joints) for joints in densified(path))
    assert connect(start, centre, free, ARM) is None, "the goal itself is not free"
