import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.lfd.evaluation.random_tasks import random_task
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import task_from_dict
from tests.helpers.demonstrations import STACK3


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), boxes=st.integers(1, 6))
def test_random_tasks_are_valid_and_the_same_for_the_same_seed(seed, boxes):
    task, again = (random_task(STACK3, boxes=boxes, rng=np.random.default_rng(seed)) for _ in range(2))
    assert task == again == task_from_dict(task.to_dict(), source="test")
    assert len(task.objects) == boxes
    assert task.targets
    assert not sample_layouts(task, seed, 1).reached.any()
