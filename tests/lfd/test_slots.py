"""Slots in demonstrated places."""

import dataclasses

import numpy as np
import pytest

from bt_jax.lfd import Demonstrations, Frames, learn
from bt_jax.lfd.contact import supports
from bt_jax.lfd.evaluation.synthetic_kits import demonstrate_kit
from bt_jax.tasks import Slot, Target, load_task

KIT4, BOLTS = load_task("kit4"), load_task("bolts")


def places(task, placements, *, count=3, **noise):
    """The places that are learnt from synthetic demonstrations of a task."""
    made = [demonstrate_kit(task, placements, rng=np.random.default_rng(d), **noise) for d in range(count)]
    return [one for one in learn(Demonstrations(Frames.of(task), tuple(made)), task).inferences if one.kind == "place"]


def with_slots(*slots):
    """kit4 with other slots in its tray."""
    return dataclasses.replace(KIT4, kits=(dataclasses.replace(KIT4.kits[0], slots=slots),))


@pytest.mark.parametrize("target", BOLTS.targets[::3], ids=lambda target: target.slot)
def test_what_stands_in_a_kit_is_put_on_that_one(target):
    one = demonstrate_kit(BOLTS, (target,), rng=np.random.default_rng(0))
    assert supports(one.actions[-1], "Bolt1", BOLTS) == (target.frame,)


def test_what_is_put_on_an_object_in_a_slot_is_in_no_slot():
    """Even if it is no further from its place in the slot than the tolerance of the task."""
    task = with_slots(Slot("plate", (0.1, 0.05)))
    task = dataclasses.replace(task, episode=dataclasses.replace(task.episode, tolerance=0.03))
    on_plate = Target("Can", (0.0, 0.0, 0.065), "Plate")
    plate, can = places(task, (Target("Plate", (0.1, 0.05, 0.0175), "Tray", 0.0, "Tray.plate"), on_plate), noise=0.003)
    assert plate.slot == "Tray.plate"
    assert can.slot == ""


def test_a_place_in_a_slot_is_the_slot_though_it_fits_better_beside_an_object():
    """What stands beside another object in a tray agrees in the frames of both, here more closely in that of the other."""
    task = with_slots(Slot("plate", (-0.1, 0.0)), Slot("can", (0.1, 0.0), takes="Can"))
    plate = Target("Plate", (-0.1, 0.0, 0.0175), "Tray", 0.0, "Tray.plate")
    found = places(task, (plate, Target("Can", (0.2, 0.0, 0.035), "Plate")), count=5, noise=0.009)
    assert [one.slot for one in found] == ["Tray.plate", "Tray.can"]
