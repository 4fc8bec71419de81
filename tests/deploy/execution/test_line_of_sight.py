import numpy as np
import pytest

from bt_jax.deploy.execution.line_of_sight import _distance, in_the_way

EYE, BOX = (1.0, 0.0, 1.0), (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("arm", "hides"),
    [
        ([[0.5, -1.0, 0.5], [0.5, 1.0, 0.5]], True),
        ([[0.5, -1.0, 0.8], [0.5, 1.0, 0.8]], False),
        ([[-1.0, 0.0, 1.0], [-0.05, 0.0, 0.05]], True),
        ([[-1.0, 0.0, 1.0], [-0.3, 0.0, 0.3]], False),
        ([[2.0, 0.0, 2.0], [1.5, 0.0, 1.5]], False),
        ([[0.5, 0.0, 0.5]], True),
    ],
)
def test_an_arm_hides_what_lies_behind_it(arm, hides):
    assert in_the_way(np.array(arm), (EYE, BOX)) == hides


def test_distances_of_segments_are_those_of_their_nearest_points():
    rng = np.random.default_rng(0)
    share = np.linspace(0, 1, 101)[:, None]
    for _ in range(50):
        a, b, c, d = rng.normal(size=(4, 3))
        first, second = a + share * (b - a), c + share * (d - c)
        brute = np.linalg.norm(first[:, None] - second[None], axis=2).min()
        assert _distance(a, b, c[None], d[None])[0] == pytest.approx(brute, abs=0.03)
        assert _distance(a, b, c[None], d[None])[0] <= brute + 1e-12
