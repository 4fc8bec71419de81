"""One window steers, the others are told who does, with a clock that the test sets."""

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.holds import IDLE_SECONDS, Holds, Window

ANNA, BEN, ANNA_TOO = Window("a", "10.0.0.1"), Window("b", "10.0.0.2"), Window("c", "10.0.0.1")


@pytest.fixture
def holds(clock):
    holds = Holds(Bus(), clock)
    holds.changes = []
    holds._bus.subscribe("holds", lambda: holds.changes.append(holds.other("gripper", BEN)))
    return holds


def test_the_second_is_told_who_has_it_and_when_it_is_free(holds):
    holds.take("gripper", ANNA)
    with pytest.raises(UserError, match=r"another window at 10\.0\.0\.1 has the gripper; wait until .* 30 seconds"):
        holds.take("gripper", BEN)
    with pytest.raises(UserError, match="another window on this computer has the gripper"):
        holds.take("gripper", ANNA_TOO)
    assert holds.sentence("gripper", ANNA) == ""
    holds.take("run", BEN)  # each thing for itself


@pytest.mark.parametrize("thing", list(IDLE_SECONDS))
def test_it_is_free_when_nothing_was_done_for_a_while(holds, clock, thing):
    holds.take(thing, ANNA)
    clock.now += IDLE_SECONDS[thing] - 1
    holds.take(thing, ANNA)  # goes on
    clock.now += IDLE_SECONDS[thing] - 1
    with pytest.raises(UserError):
        holds.take(thing, BEN)
    clock.now += 1
    holds.take(thing, BEN)
    with pytest.raises(UserError):
        holds.take(thing, ANNA)


def test_it_is_kept_longer_on_a_page_for_people_who_need_time(clock):
    holds = Holds(Bus(), clock, factor=3.0)
    holds.take("run", ANNA)
    clock.now += 3 * IDLE_SECONDS["run"] - 1
    with pytest.raises(UserError, match="nothing for 15 seconds"):
        holds.take("run", BEN)
    clock.now += 1
    holds.take("run", BEN)


def test_it_is_free_when_the_window_lets_go(holds):
    holds.take("gripper", ANNA)
    holds.take("task", BEN)
    holds.let_go(ANNA)
    holds.take("gripper", BEN)
    assert holds.other("task", ANNA) == BEN


def test_every_change_is_announced_once(holds, clock):
    holds.take("gripper", ANNA)
    holds.take("gripper", ANNA)
    holds.expire()
    assert holds.changes == [ANNA]
    clock.now += IDLE_SECONDS["gripper"]
    holds.expire()
    holds.expire()
    assert holds.changes == [ANNA, None]
    holds.let_go(ANNA)
    assert holds.changes == [ANNA, None]
