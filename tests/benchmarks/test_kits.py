"""Kits and towers of any number of objects: the tasks that the measurements of scaling are made with."""

import pytest

from benchmarks._kits import kit, named, tower
from bt_jax.tasks import load_task
from bt_jax.tasks.checks import check, check_support


@pytest.mark.parametrize(("make", "most"), [(kit, 12), (tower, 8)])
def test_all_sizes_are_valid_tasks_with_one_target_for_each_object(make, most):
    for count in range(2, most + 1):
        task = make(count)
        check(task, task.name)
        check_support(task, task.name)
        assert len(task.objects) == len(task.targets) == count


def test_the_largest_kit_is_that_of_the_package():
    whole = load_task("kit12")
    assert (kit(12).objects, kit(12).kits, kit(12).targets) == (whole.objects, whole.kits, whole.targets)
    assert kit(12).episode == whole.episode


def test_tasks_are_made_and_read_by_name():
    assert named("tower-of-3").name == "tower-of-3"
    assert named("kit-of-5").name == "kit-of-5"
    assert named("stack") == load_task("stack")
