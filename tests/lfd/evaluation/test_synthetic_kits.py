"""Kits that are packed by computer, and what is learnt from that."""

import dataclasses

import numpy as np
import pytest

from bt_jax.lfd import Action, Demonstrations, Frames, Pose, learn
from bt_jax.lfd.evaluation.assessment import assess, kit_example
from bt_jax.lfd.evaluation.synthetic_kits import demonstrate_kit, random_kit
from bt_jax.lfd.turns import apart
from bt_jax.tasks import load_task

KIT4, BOLTS = load_task("kit4"), load_task("bolts")


def kit(seed):
    rng = np.random.default_rng(seed)
    return random_kit(KIT4, objects=int(rng.integers(2, 6)), rng=rng)


@pytest.mark.parametrize("seed", range(10))
def test_a_demonstration_shows_what_was_meant(seed):
    task = kit(seed)
    one = demonstrate_kit(task, task.targets, rng=np.random.default_rng(seed))
    things = one.things(Frames.of(task))
    assert [action.kind for action in one.actions] == ["pick", "place"] * len(task.targets)
    for target, place, thing in zip(task.targets, one.actions[1::2], things[1::2], strict=True):
        assert thing in task.instances[target.object]
        np.testing.assert_allclose(place.handled(target.frame), target.position, atol=1e-9)
        if target.turn is not None:
            turn = np.array([place.turn(thing, target.frame)])
            assert apart(turn, target.turn, task.thing(thing).symmetry)[0] < 1e-6
    assert len(set(things[::2])) == len(things[::2])


@pytest.mark.parametrize("seed", range(8))
def test_turns_slots_and_parts_are_learnt(seed):
    task = kit(seed)
    example = kit_example(task, seed=[seed], count=4, noise=0.003, turn_noise=1.0, reorder=bool(seed % 2))
    found = assess(learn(example.demonstrations, task), example)
    assert found.lenient == found.turns == found.slots == found.placements
    assert found.goal
    assert found.order


def test_an_instance_counts_where_it_was_left_last():
    """It is put aside, and then into a slot: only that is left of both, though another instance may stand aside."""
    moved = []
    for d in range(4):
        one = demonstrate_kit(BOLTS, BOLTS.targets[:1], rng=np.random.default_rng(d))
        hold, put = one.actions
        thing = one.things(Frames.of(BOLTS))[0]
        away = {frame: pose.compose(Pose((0.0, 0.3, 0.0))) for frame, pose in hold.poses.items()}
        aside = Action("place", {**away, thing: hold.poses[thing]})
        again = dataclasses.replace(aside, kind="pick")
        moved.append(dataclasses.replace(one, actions=(hold, aside, again, put)))
    lesson = learn(Demonstrations(Frames.of(BOLTS), tuple(moved)), BOLTS)
    assert lesson.targets == BOLTS.targets[:1]


@pytest.mark.parametrize("count", [1, 2])
def test_slots_are_known_from_few_demonstrations(count):
    example = kit_example(KIT4, seed=[0], count=count, noise=0.002, turn_noise=1.0, reorder=False)
    lesson = learn(example.demonstrations, KIT4)
    assert set(lesson.targets) == set(KIT4.targets)
    assert len(lesson.inferences) == 2 * len(KIT4.targets)
