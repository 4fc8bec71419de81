import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.lfd.evaluation.random_kits import random_kit_task
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task, task_from_dict

KIT4 = load_task("kit4")


def made(seed, objects=6):
    return random_kit_task(KIT4, objects=objects, rng=np.random.default_rng(seed))


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), objects=st.integers(1, 8))
def test_random_kits_are_valid_and_the_same_for_the_same_seed(seed, objects):
    task = made(seed, objects)
    assert task == made(seed, objects) == task_from_dict(task.to_dict(), source="test")
    assert len(task.objects) == objects
    assert task.targets
    sample_layouts(task, seed, 1)


def test_random_kits_hold_everything_that_a_kit_may_hold():
    tasks = [made(seed) for seed in range(40)]
    targets = [target for task in tasks for target in task.targets]
    assert {thing.shape for task in tasks for thing in task.objects} == {"cuboid", "cylinder"}
    assert any(target.object not in task.object_names for task in tasks for target in task.targets)
    assert {target.turn for target in targets} >= {None, 0.0, 30.0, 90.0}
    assert {target.frame for target in targets} > {"TrayA", "TrayB", KIT4.robot_frame}
    assert any(task.layout.fixed for task in tasks)
    assert any(task.layout.stack for task in tasks)
