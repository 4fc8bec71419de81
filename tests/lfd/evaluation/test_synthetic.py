import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.lfd.demonstration import Frames
from bt_jax.lfd.evaluation.synthetic import demonstrate, random_truth, reordered, with_boxes
from bt_jax.tasks import Target, load_task, task_from_dict
from tests.helpers.demonstrations import RESTACK, STACK3, STACKING

seeds = st.integers(0, 10**6)


def generator(seed):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_tasks_with_other_numbers_of_boxes_make_sense(count):
    task = with_boxes(load_task("stack"), count)
    assert len(task.objects) == len(set(task.object_names)) == count
    assert task_from_dict(task.to_dict(), source="test") == task


@given(seed=seeds, noise=st.floats(0, 0.01))
def test_a_place_is_the_true_one_but_for_the_noise(seed, noise):
    shown = demonstrate(STACK3, STACKING, rng=generator(seed), noise=noise)
    assert [action.kind for action in shown.actions] == ["pick", "place"] * 3
    for action, placement in zip(shown.actions[1::2], STACKING, strict=True):
        error = np.linalg.norm(action.handled(placement.frame) - placement.position)
        assert error <= 6 * noise + 1e-12
    for action, placement in zip(shown.actions[::2], STACKING, strict=True):
        assert action.nearest(Frames.of(STACK3).objects) == placement.object
        np.testing.assert_allclose(action.handled(placement.object), 0, atol=1e-12)


@given(seed=seeds)
def test_without_noise_the_layout_is_the_same(seed):
    noisy, exact = (demonstrate(STACK3, STACKING, rng=generator(seed), noise=noise) for noise in (0.01, 0.0))
    for frame in Frames.of(STACK3).names:
        assert noisy.actions[0].poses[frame] == exact.actions[0].poses[frame]


@given(seed=seeds)
def test_layouts_are_the_tasks(seed):
    def centres(task):
        first = demonstrate(task, STACKING, rng=generator(seed)).actions[0]
        return {name: first.handled("base_link") - first.handled(name) + task.robot_position for name in task.frames}

    apart, stacked = centres(STACK3), centres(RESTACK)
    boxes = [apart[name][:2] for name in STACK3.object_names]
    gaps = [np.linalg.norm(a - b) for i, a in enumerate(boxes) for b in boxes[:i]]
    assert min(gaps) >= STACK3.layout.spacing
    assert all(round(apart["KittingBox"][0]) != round(box[0]) for box in boxes)
    tower = [stacked[name] for name in RESTACK.layout.stack]
    np.testing.assert_allclose(np.diff(tower, axis=0), [[0, 0, 0.1]] * 2, atol=1e-12)


@given(seed=seeds, boxes=st.integers(2, 6))
def test_random_placements_are_possible(seed, boxes):
    """The oracle keeps what stands on what: no box is moved from under another, none goes where one stands."""
    task = with_boxes(STACK3, boxes)
    truth = random_truth(task, rng=generator(seed))
    assert truth == random_truth(task, rng=generator(seed))
    at: dict[str, Target] = {}
    for placement in truth:
        assert not any(other.frame == placement.object for other in at.values())
        at[placement.object] = placement
        taken = [(one.position, one.frame) for one in at.values()]
        assert len(set(taken)) == len(taken)


@given(seed=seeds)
def test_reordering_keeps_what_depends_on_each_other(seed):
    truth = random_truth(with_boxes(STACK3, 6), rng=generator(seed))
    other = reordered(truth, rng=generator(seed + 1))
    assert sorted(map(str, truth)) == sorted(map(str, other))
    for i, later in enumerate(truth):
        for earlier in truth[:i]:
            if {later.object, later.frame} & {earlier.object} or later.object == earlier.frame:
                assert other.index(earlier) < other.index(later)
