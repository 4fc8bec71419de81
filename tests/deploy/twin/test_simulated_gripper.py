import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.twin.settings import Realism
from bt_jax.deploy.twin.simulated_gripper import GripperFault, SimulatedGripper

CYCLE = 0.004


def test_a_command_is_seen_at_the_next_look_and_takes_effect_after_the_delay():
    realism = dataclasses.replace(Realism(), gripper_delay=0.2, gripper_reading=0.05)
    gripper = SimulatedGripper(realism, 25.0, 10.0)
    begun = None
    for i in range(200):
        now = i * CYCLE
        target = 25.0 if now < 0.1 else 12.0
        gripper.serve(now, target=target, force=15.0, position=25.0 - now)
        if gripper.advance(now).target != 25.0 and begun is None:
            begun = now
    assert 0.1 + 0.2 <= begun <= 0.1 + 0.2 + 0.05 + CYCLE
    assert gripper.grip.force == 15.0


def test_closing_goes_on_until_something_is_met_and_opening_to_the_target():
    gripper = SimulatedGripper(Realism.perfect(), 25.0, 10.0)
    gripper.serve(0.0, target=12.0, force=10.0, position=25.0)
    assert gripper.advance(0.0).target == 0.0
    gripper.serve(1.0, target=20.0, force=10.0, position=0.0)
    assert gripper.advance(1.0).target == 20.0
    gripper.serve(2.0, target=20.01, force=3.0, position=20.0)
    assert gripper.advance(2.0).force == 10.0, "a change that small is none"


@pytest.mark.parametrize("period", [0.0, 0.05])
def test_a_reading_is_as_old_as_the_last_look(period):
    gripper = SimulatedGripper(dataclasses.replace(Realism.perfect(), gripper_reading=period), 25.0, 10.0)
    ages = []
    for i in range(500):
        now = i * CYCLE
        gripper.serve(now, target=25.0, force=10.0, position=now)
        ages.append(now - gripper.reading)
    assert max(ages) == pytest.approx(max(period - CYCLE, 0.0), abs=CYCLE)
    assert np.all(np.diff([i * CYCLE - age for i, age in enumerate(ages)]) >= -1e-9)


def test_a_gripper_that_jams_does_not_do_what_it_was_told_then():
    gripper = SimulatedGripper(Realism.perfect(), 25.0, 10.0)
    gripper.fault = GripperFault.JAM
    gripper.serve(0.0, target=12.0, force=10.0, position=25.0)
    assert gripper.advance(0.0).target == 25.0
    gripper.fault = GripperFault.NONE
    gripper.serve(1.0, target=12.0, force=10.0, position=25.0)
    assert gripper.advance(1.0).target == 25.0, "nobody told it again"
    gripper.serve(2.0, target=25.0, force=10.0, position=25.0)
    gripper.serve(3.0, target=12.0, force=10.0, position=25.0)
    assert gripper.advance(3.0).target == 0.0


def test_a_weak_gripper_moves_and_hardly_presses():
    gripper = SimulatedGripper(Realism.perfect(), 25.0, 10.0)
    gripper.fault = GripperFault.WEAK
    gripper.serve(0.0, target=12.0, force=15.0, position=25.0)
    assert gripper.advance(0.0).target == 0.0
    assert gripper.advance(0.0).force < 0.1
    gripper.fault = GripperFault.NONE
    assert gripper.advance(0.0).force == 15.0
