"""What is told of pose tracks: noise, gaps, hands, and whatever a person may do wrong."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.teaching.watch.rest import WatchSettings
from bt_jax.teaching.watch.watcher import Watcher
from tests.helpers.watched import IN_KIT, KIT, ON_GREEN, ON_YELLOW, PLACES, TASK, Table, watch

FREE = (0.25, 0.26, 0.02)


def stacking(table, *, unseen=False):
    yield from table.wait(1.5)
    yield from table.carry("YellowBox", IN_KIT, unseen=unseen)
    yield from table.carry("GreenBox", ON_YELLOW, unseen=unseen, degrees=90)
    yield from table.carry("BlueBox", ON_GREEN, unseen=unseen)


def moved(watched):
    return [(move.box, move.kind, move.under) for move in watched.moves]


STACKED = [("YellowBox", "carried", KIT), ("GreenBox", "carried", "YellowBox"), ("BlueBox", "carried", "GreenBox")]


@pytest.mark.parametrize("unseen", [False, True], ids=["in sight", "hidden by the hand"])
def test_a_stack_is_told_as_it_grows(unseen):
    events, watched = watch(stacking(Table(), unseen=unseen))
    assert [event.text for event in events] == [
        "start: YellowBox, GreenBox, BlueBox, KittingBox are at rest",
        "YellowBox is moving",
        f"YellowBox stands in {KIT}",
        "GreenBox is moving",
        "GreenBox stands on YellowBox",
        "BlueBox is moving",
        "BlueBox stands on GreenBox",
        "done: 3 moves",
    ]
    assert moved(watched) == STACKED
    assert not watched.doubts


@settings(max_examples=12)
@given(
    seed=st.integers(0, 10**6),
    noise=st.floats(0.0002, 0.0012),
    lost=st.floats(0, 0.3),
    step=st.sampled_from([0.07, 0.1, 0.2, 0.25]),
    unseen=st.booleans(),
)
def test_noise_gaps_and_rate_change_nothing_that_is_told(seed, noise, lost, step, unseen):
    table = Table(np.random.default_rng(seed), noise=noise, lost=lost, step=step)
    _, watched = watch(itertools.chain(stacking(table, unseen=unseen), table.wait(1)))
    assert moved(watched) == STACKED
    assert not watched.doubts
    for move, place in zip(watched.moves, (IN_KIT, ON_YELLOW, ON_GREEN), strict=True):
        assert np.linalg.norm(move.after.pose.translation - place) < 0.0012
        assert 0 < move.after.sigma < 0.003


@given(st.permutations(["YellowBox", "GreenBox", "BlueBox"]))
def test_moves_are_told_in_the_order_in_which_they_were_made(order):
    table, spots = Table(), {name: (0.3, 0.08 * i - 0.08, 0.022) for i, name in enumerate(PLACES) if name != KIT}

    def film():
        yield from table.wait(1)
        for name in order:
            yield from table.carry(name, spots[name], unseen=name == "GreenBox")

    _, watched = watch(film())
    assert [move.box for move in watched.moves] == order


def test_a_box_that_is_held_still_in_the_air_stands_nowhere():
    table = Table()

    def film():
        yield from table.wait(1)
        yield from table.carry("YellowBox", (0.3, 0.0, 0.15))
        yield from table.wait(5)

    events, watched = watch(film())
    assert not watched.moves
    assert [doubt.text for doubt in watched.doubts] == ["YellowBox is not at rest at the end"]
    assert "stands" not in {event.kind for event in events}


def test_a_move_does_not_count_while_a_hand_covers_the_box_or_what_is_near_it():
    table = Table()

    def film():
        yield from table.wait(1)
        yield from table.carry("YellowBox", IN_KIT)
        table.put("GreenBox", (0.3, -0.02, 0.15))
        yield from table.wait(0.3)
        table.put("GreenBox", ON_YELLOW)
        table.covered |= {"YellowBox"}
        yield from table.wait(1.5)

    watcher = Watcher(TASK)
    watch(film(), watcher)
    assert [move.box for move in watcher.moves] == ["YellowBox"]
    table.covered.clear()
    watch(table.wait(1), watcher)
    assert [move.box for move in watcher.moves] == ["YellowBox", "GreenBox"]


def test_a_face_that_is_never_read_delays_and_does_not_prevent():
    table = Table(covered={"YellowBox"})

    def film():
        yield from table.wait(4)
        yield from table.carry("YellowBox", IN_KIT)
        table.covered.add("YellowBox")
        yield from table.wait(WatchSettings().patience + 1)

    assert moved(watch(film())[1]) == STACKED[:1]


def test_it_begins_only_when_everything_is_in_sight():
    table = Table(hidden={"BlueBox"})
    watcher = Watcher(TASK)
    watch(table.wait(2), watcher)
    assert (watcher.started, watcher.missing) == (False, ("BlueBox",))
    table.hidden.clear()
    watch(table.wait(1), watcher)
    assert (watcher.started, watcher.missing) == (True, ())


def both_at_once(table):
    yield from table.wait(1)
    start = {name: table.poses[name].translation for name in ("YellowBox", "GreenBox")}
    for i in range(1, 16):
        for name, goal in (("YellowBox", IN_KIT), ("GreenBox", (0.3, 0.06, 0.022))):
            lift = np.array([0, 0, 0.4 * i / 15 * (1 - i / 15)])
            table.put(name, (1 - i / 15) * start[name] + i / 15 * np.array(goal) + lift)
        yield table.look()
    yield from table.wait(1.5)


def twice(table):
    yield from table.wait(1)
    yield from table.carry("BlueBox", FREE)
    yield from table.carry("BlueBox", IN_KIT)


def again_later(table):
    yield from table.wait(1)
    yield from table.carry("BlueBox", FREE)
    yield from table.carry("YellowBox", IN_KIT)
    yield from table.carry("BlueBox", ON_YELLOW)


def bumped(table):
    yield from table.wait(1)
    yield from table.carry("GreenBox", (0.339, -0.2, 0.02), seconds=0.3)
    yield from table.carry("YellowBox", IN_KIT)


def kit_pushed(table):
    yield from table.wait(1)
    yield from table.carry("YellowBox", IN_KIT)
    table.put(KIT, (0.31, 0.01, 0.001))
    table.put("YellowBox", (0.31, 0.01, 0.022))
    yield from table.wait(1.5)


def taken_away(table):
    yield from table.wait(1)
    yield from table.carry("YellowBox", IN_KIT)
    for i in range(8):
        table.put("BlueBox", (0.28 + 0.05 * i, -0.29, 0.1))
        yield table.look()
    table.hidden.add("BlueBox")
    yield from table.wait(2)


def hidden_at_the_end(table):
    yield from table.wait(1)
    yield from table.carry("YellowBox", IN_KIT)
    table.hidden.add("BlueBox")
    yield from table.wait(2)


DOUBTS = {
    both_at_once: ("together", "YellowBox and GreenBox were moved at once", "keep"),
    twice: ("twice", "BlueBox was moved twice", "leave out"),
    again_later: ("twice", "BlueBox was moved twice", "keep"),
    bumped: ("bumped", "GreenBox was bumped, by 9 mm and 0 degrees", "leave out"),
    kit_pushed: ("bumped", "KittingBox was bumped, by 14 mm and 0 degrees", "leave out"),
    taken_away: ("lost", "BlueBox has left the view", "leave out"),
    hidden_at_the_end: ("lost", "BlueBox is out of sight at the end", "leave out"),
}


@pytest.mark.parametrize("film", DOUBTS, ids=lambda film: film.__name__)
def test_what_is_in_doubt_is_said(film):
    events, watched = watch(film(Table()))
    kind, text, usual = DOUBTS[film]
    assert (kind, text, usual) in [(doubt.kind, doubt.text, doubt.usual) for doubt in watched.doubts]
    assert text in [event.text for event in events if event.kind == "doubt"]


def test_a_box_that_another_stands_on_is_not_lost_because_it_cannot_be_seen():
    table = Table()

    def film():
        yield from stacking(table)
        table.hidden |= {"YellowBox", "GreenBox"}
        yield from table.wait(2)

    assert not watch(film())[1].doubts


def test_one_hand_that_goes_straight_to_the_next_box_moves_one_at_a_time():
    table = Table()

    def film():
        yield from table.wait(1)
        for sighting in table.carry("YellowBox", IN_KIT):
            if sighting.time > 2.7:  # the hand has let go, and covers it from afar while it takes the next box
                table.covered.add("YellowBox")
            yield sighting
        yield from table.carry("GreenBox", (0.3, 0.06, 0.022), unseen=True)
        table.covered.clear()
        yield from table.wait(1.5)

    _, watched = watch(film())
    assert [move.box for move in watched.moves] == ["YellowBox", "GreenBox"]
    assert not watched.doubts


def test_a_box_that_is_put_back_was_not_moved():
    table = Table()

    def film():
        yield from table.wait(1)
        yield from table.carry("YellowBox", PLACES["YellowBox"])

    events, watched = watch(film())
    assert [event.text for event in events][-2:] == ["YellowBox is back where it was", "done: 0 moves"]
    assert moved(watched) == [("YellowBox", "returned", "TableRight" if PLACES["YellowBox"][1] < 0 else "TableLeft")]


def test_it_is_over_once_nothing_has_moved_for_long_enough():
    table, watcher = Table(), Watcher(TASK, WatchSettings(idle=3.0))
    watch(table.wait(8), watcher)
    assert not watcher.over  # nothing was shown yet
    watch(table.carry("YellowBox", IN_KIT), watcher)
    watch(table.wait(1), watcher)
    assert not watcher.over
    watch(table.wait(2), watcher)
    assert watcher.over
