import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from bt_jax.lfd.dbscan import dbscan


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 60),
    side=st.sampled_from([0.2, 0.6, 1.5]),
    min_samples=st.integers(1, 6),
)
def test_labels_are_those_of_scikit_learn(seed, count, side, min_samples):
    points = np.random.default_rng(seed).uniform(0, side, (count, 3))
    expected = DBSCAN(eps=0.2, min_samples=min_samples, algorithm="kd_tree").fit_predict(points)
    np.testing.assert_array_equal(dbscan(points, 0.2, min_samples), expected)


@pytest.mark.parametrize(
    ("middle", "labels"),
    [
        ([1.0], [0, 0, 0, -1, 1, 1, 1]),  # two clusters and noise between them
        ([0.3], [0, 0, 0, 0, 1, 1, 1]),  # a border point of one
    ],
)
def test_noise_and_border_points(middle, labels):
    points = np.array([[0.0], [0.1], [0.15], middle, [2.0], [2.1], [2.2]])
    assert dbscan(points, 0.2, 3).tolist() == labels


def test_border_point_of_two_clusters_joins_the_first():
    points = np.array([[0.0], [0.05], [0.1], [0.3], [0.5], [0.55], [0.6]])
    assert dbscan(points, 0.21, 4).tolist() == [0, 0, 0, 0, 1, 1, 1]
