import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.tasks import Target, load_task, with_target, with_targets

BOLTS, STACK = load_task("bolts"), load_task("stack")
ON_TABLE = Target("Bolt", (1.0, 1.0, 0.73), BOLTS.robot_frame)


@given(st.sets(st.sampled_from(BOLTS.targets), min_size=1), st.permutations(BOLTS.targets))
def test_a_part_keeps_its_targets_and_gets_those_it_lacks(had, added):
    task = dataclasses.replace(BOLTS, targets=tuple(had))
    changed = with_targets(task, added, source="mine")
    assert changed.targets[: len(had)] == task.targets
    assert len(changed.targets) == len(BOLTS.targets)
    assert set(changed.targets) == set(BOLTS.targets)


def test_a_target_of_a_part_replaces_the_one_in_that_place():
    old = BOLTS.targets[0]
    x, y, z = old.position
    new = dataclasses.replace(old, position=(x + BOLTS.episode.tolerance / 2, y, z))
    assert with_targets(BOLTS, [new], source="mine").targets == (new, *BOLTS.targets[1:])


def test_a_target_of_an_object_replaces_the_one_it_has():
    new = dataclasses.replace(STACK.targets[0], position=(0.1, 0.1, 0.052))
    assert with_targets(STACK, [new], source="mine").targets == (new, *STACK.targets[1:])


def test_one_more_target_has_time_and_other_problems_may_stay():
    task = dataclasses.replace(STACK, targets=(), episode=dataclasses.replace(STACK.episode, max_ticks=2))
    for number, name in enumerate(STACK.object_names, start=1):
        there = Target(name, (-0.12 + 0.12 * (number - 1), 0.0, 0.052), "KittingBox")
        task = with_target(task, there, instead_of=None, source="mine")
    assert (len(task.targets), task.episode.max_ticks) == (3, 15)
    wide = dataclasses.replace(STACK, gripper_opening=0.05)
    moved = dataclasses.replace(STACK.targets[0], position=(0.1, 0.1, 0.052))
    assert with_target(wide, moved, instead_of=STACK.targets[0], source="mine").targets[0] == moved
    outside = dataclasses.replace(moved, position=(0.2, 0.1, 0.052))
    with pytest.raises(UserError, match="mine: YellowBox would be inside the kit's walls"):
        with_target(wide, outside, instead_of=STACK.targets[0], source="mine")


def test_more_targets_than_instances_are_refused():
    with pytest.raises(UserError, match=r"^mine, key targets\[6\].object: there are only 6 of Bolt"):
        with_targets(BOLTS, [ON_TABLE], source="mine")
