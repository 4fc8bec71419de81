import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.tracker import Tracker, TrackerSettings

SETTINGS = TrackerSettings(max_age=1.0, frames=3)
HERE = RigidTransform.from_translation([0.3, 0.1, 0.02])
THERE = RigidTransform.from_translation([0.3, -0.2, 0.02])


def fed(*measurements: RigidTransform | None, period: float = 0.1) -> Tracker:
    tracker = Tracker(SETTINGS)
    for i, pose in enumerate(measurements):
        tracker.update(i * period, {} if pose is None else {"box": pose})
    return tracker


def known(tracker: Tracker, time: float) -> np.ndarray | None:
    pose = tracker.poses(time).get("box")
    return None if pose is None else pose.translation


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_place_is_believed_after_several_images(count):
    assert (known(fed(*[HERE] * count), 0.3) is not None) == (count >= 3)


def test_knowledge_has_an_age():
    tracker = fed(HERE, HERE, HERE)
    assert known(tracker, 1.2) is not None
    assert known(tracker, 1.21) is None


def test_stale_knowledge_does_not_make_one_image_enough():
    tracker = fed(HERE, HERE, HERE)
    tracker.update(5.0, {"box": HERE})
    assert known(tracker, 5.0) is None


def test_one_wrong_measurement_changes_nothing():
    tracker = fed(HERE, HERE, HERE, THERE, HERE)
    np.testing.assert_allclose(known(tracker, 0.4), HERE.translation)


def test_a_measurement_that_is_worth_little_moves_little():
    poor = RigidTransform.from_translation(HERE.translation + np.array([0.004, 0, 0]))
    moved = []
    for sigma in (0.0005, 0.003):
        tracker = fed(*[HERE] * 5)
        for i in range(5, 10):
            tracker.update(i * 0.1, {"box": poor}, {"box": sigma})
        moved.append(known(tracker, 0.9)[0] - HERE.translation[0])
    assert moved[0] == pytest.approx(0.004)
    assert moved[1] < 0.0015


def test_a_jump_is_unknown_until_it_is_sure():
    tracker = fed(HERE, HERE, HERE, THERE, THERE)
    assert known(tracker, 0.4) is None
    tracker.update(0.5, {"box": THERE})
    np.testing.assert_allclose(known(tracker, 0.5), THERE.translation)


@pytest.mark.parametrize("before", [2, 3])
@pytest.mark.parametrize("away", [0.05, 0.12, 0.3])
def test_who_was_hidden_and_is_seen_elsewhere_has_jumped(before, away):
    """Though it could have moved there in time: one image is not enough."""
    there = RigidTransform.from_translation(HERE.translation - np.array([0, away, 0]))
    tracker = fed(*[HERE] * before, *[None] * 5, there)
    seen = known(tracker, 0.1 * (before + 5))
    assert seen is None if before < 3 else np.allclose(seen, HERE.translation)
    for i in range(2):
        tracker.update(0.1 * (before + 6 + i), {"box": there})
    np.testing.assert_allclose(known(tracker, 0.1 * (before + 7)), there.translation)


def test_a_flip_is_a_jump():
    flipped = RigidTransform.from_components(HERE.translation, Rotation.from_euler("x", 90, degrees=True))
    assert (known(fed(HERE, HERE, HERE, flipped), 0.3) == HERE.translation).all()
    assert known(fed(HERE, HERE, HERE, flipped, flipped), 0.4) is None


def test_wild_measurements_are_never_believed():
    rng = np.random.default_rng(0)
    wild = [RigidTransform.from_translation(rng.uniform(-0.5, 0.5, 3)) for _ in range(30)]
    tracker = fed(HERE, HERE, HERE, *wild)
    assert known(tracker, 3.3) is None


def test_an_old_image_is_ignored():
    tracker = fed(HERE, HERE, HERE)
    for _ in range(5):
        tracker.update(0.2, {"box": THERE})
        tracker.update(0.1, {"box": THERE})
    np.testing.assert_allclose(known(tracker, 0.2), HERE.translation)


def test_noise_is_averaged_at_rest_and_motion_is_followed():
    rng = np.random.default_rng(1)
    noisy = [RigidTransform.from_translation(HERE.translation + rng.normal(0, 0.0004, 3)) for _ in range(60)]
    last = known(fed(*noisy), 5.9)
    assert np.linalg.norm(last - HERE.translation) < 0.0005
    moving = [RigidTransform.from_translation(HERE.translation + np.array([0.02 * i, 0, 0])) for i in range(20)]
    np.testing.assert_allclose(known(fed(*moving), 1.9), moving[-1].translation)


@given(st.lists(st.sampled_from([None, HERE, THERE]), max_size=25))
def test_what_is_believed_was_seen_there_lately(sequence):
    tracker = Tracker(SETTINGS)
    for i, pose in enumerate(sequence):
        tracker.update(0.1 * i, {} if pose is None else {"box": pose})
        believed = known(tracker, 0.1 * i)
        if believed is not None:
            recent = [p for p in sequence[max(0, i - 10) : i + 1] if p is not None]
            assert sum(bool(np.allclose(p.translation, believed)) for p in recent) >= 1
            assert sum(p is not None and bool(np.allclose(p.translation, believed)) for p in sequence[: i + 1]) >= 3
