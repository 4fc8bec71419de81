"""Why a run ends by itself: attempts without progress, what is wrong with the picture, and what is out of sight."""

import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import Behavior
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.observation import Finding
from bt_jax.deploy.execution.settings import Exit, Limits
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.status import Status
from tests.helpers.ideal import TASK, IdealCell

PICK = {name: Behavior("pick", (name,)) for name in TASK.object_names}
OFF = Finding("", "the camera is 5 mm off: calibrate again", stops=True)


def test_attempts_that_are_broken_off_without_end_are_bounded_and_the_reason_is_told():
    """A box that seems to be here and there by turns, as one whose marker is seen twice."""
    cell = IdealCell(limits=Limits(look=0.0))
    goal, there = cell.skills.world.kits[0, 0] + np.array([0, 0, 0.055]), np.array([1.3, 0.2, 0.8])
    cell.skills.polls = 10**6
    cell.findings = (Finding("YellowBox", "YellowBox's marker is seen twice"), Finding("OtherBox", "OtherBox burns"))
    cell.on_tick = lambda shown: cell.move("YellowBox", goal if len(cell.shown) // 12 % 2 else there)
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert outcome.seconds < 20.0
    assert f"{PICK['YellowBox']} was broken off 5 times: the tree wants" in outcome.reason
    assert outcome.reason.endswith("YellowBox's marker is seen twice")


def test_what_is_achieved_between_interruptions_gives_new_attempts():
    cell = IdealCell(limits=Limits(look=0.0, broken_off=2))
    goal = cell.skills.world.kits[0, 0] + np.array([0, 0, 0.055])

    def meddle(shown):
        if cell.skills.action == PICK["YellowBox"] and len(cell.skills.cancelled) < 2:
            cell.move("YellowBox", goal)
        if cell.skills.action == PICK["GreenBox"] and cell.skills.started.count(PICK["YellowBox"]) < 2:
            cell.move("YellowBox", (1.3, 0.2, 0.8))

    cell.on_tick = meddle
    assert cell.executor.run().exit_code == Exit.DONE


def test_a_finding_that_makes_what_is_known_wrong_ends_the_run_if_it_lasts():
    cell = IdealCell()
    cell.skills.polls = 10**6
    cell.on_tick = lambda shown: setattr(cell, "findings", (OFF,) if 2.0 < shown.seen.time < 3.5 else ())
    cell.executor.limits = Limits(run=8.0)
    assert "time is up" in cell.executor.run().reason, "it did not last"
    cell = IdealCell()
    cell.findings = (OFF,)
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.reason) == (Exit.FAILED, OFF.text)
    assert outcome.seconds <= Limits().finding + 0.5


@pytest.mark.parametrize(("limits", "reason"), [(Limits(), OFF.text), (Limits(run=3.0), "time is up")])
def test_what_ends_a_run_waits_for_a_committed_phase(limits, reason):
    """Fingers that close, or a box that is being set down."""
    cell = IdealCell(limits=limits)
    cell.skills.polls, cell.skills.committed = 60, True
    cell.on_tick = lambda shown: setattr(cell, "findings", (OFF,) if reason == OFF.text else ())
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert reason in outcome.reason
    assert cell.skills.cancelled == []
    assert 6.0 <= outcome.seconds < 6.5, "at once after it"


def test_a_stop_of_the_robot_waits_for_no_phase():
    cell = IdealCell()
    cell.skills.polls, cell.skills.committed = 60, True
    cell.on_tick = lambda shown: setattr(cell.link, "reason", "left: no feedback" if shown.seen.time > 1.0 else None)
    assert cell.executor.run().exit_code == Exit.STOPPED
    assert cell.link.time < 2.0


def test_a_committed_phase_without_end_is_ended():
    cell = IdealCell(limits=Limits(run=3.0, action=20.0))
    cell.skills.polls, cell.skills.committed = 10**6, True
    assert cell.executor.run().seconds < 24.0


def test_a_hand_that_covers_a_box_is_waited_for():
    hand = Finding(
        "YellowBox", "something unknown is on YellowBox", stops=True, sight=((0.0, 0.0, 1.0), (0.3, 0.0, 0.0))
    )
    cell = IdealCell()
    cell.on_tick = lambda shown: setattr(cell, "findings", (hand,) if 1.0 < shown.seen.time < 8.0 else ())
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.reason) == (Exit.DONE, "the tree has succeeded")
    assert outcome.seconds > 8.0
    cell = IdealCell()
    cell.findings = (hand,)
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.reason) == (Exit.FAILED, hand.text)
    assert outcome.seconds == pytest.approx(Limits().covered, abs=0.5)


@pytest.mark.parametrize("hidden", [set(), {"YellowBox"}, {"KittingBox"}])
def test_what_a_run_does_depends_on_no_clock_that_begins_at_0(hidden):
    """A real link's clock counts from when the computer was switched on."""
    runs = []
    for start in (0.0, 86400.0):
        cell = IdealCell()
        cell.link.time, cell.hide = start, hidden
        outcome = cell.executor.run()
        runs.append(outcome)
    assert runs[0].exit_code == runs[1].exit_code
    assert runs[0].seconds == pytest.approx(runs[1].seconds, abs=1.5), "rounding shifts some ticks"


def test_nothing_is_done_while_what_is_known_is_wrong():
    twice = Finding("GreenBox", "GreenBox's markers are on two things", stops=True)
    cell = IdealCell()
    cell.skills.polls = 10

    def doubt(shown):
        paused = sum(tick.phase == "pausing" for tick in cell.shown)
        acting = len(cell.skills.started) == 2 and cell.skills.left < 5
        cell.findings = (twice,) if 0 < paused < 10 or (acting and not paused) else ()

    cell.on_tick = doubt
    assert cell.executor.run().exit_code == Exit.DONE
    assert len(cell.skills.cancelled) == 1
    pauses = [i for i, tick in enumerate(cell.shown) if tick.phase == "pausing"]
    assert pauses == list(range(pauses[0], pauses[0] + 10))


def test_what_was_hidden_for_long_is_waited_for_less():
    cell = IdealCell(PICK["YellowBox"])
    cell.skills.polls = 100
    cell.hide.add("YellowBox")
    outcome = cell.executor.run()
    assert outcome.reason == "the tree has failed: YellowBox is not seen"
    assert 10.0 < outcome.seconds < 20.0, "the arms take 10 s out of the way"


def test_what_was_tried_too_often_is_waited_for_less(monkeypatch):
    cell = IdealCell(PICK["YellowBox"])
    monkeypatch.setattr(cell.skills, "poll", lambda seen: Status.FAILURE)
    begun = []
    start = cell.skills.start
    monkeypatch.setattr(cell.skills, "start", lambda *arguments: (begun.append(cell.link.time), start(*arguments)))
    outcome = cell.executor.run()
    assert len(begun) == TASK.episode.action_ticks
    assert 5.0 <= outcome.seconds - begun[-1] < 7.0


def test_a_box_out_of_reach_may_be_brought_nearer_for_longer():
    cell = IdealCell(PICK["YellowBox"])
    cell.skills.out_of_reach.add("YellowBox")
    assert 10.0 <= cell.executor.run().seconds < 12.0


def test_nothing_is_begun_with_what_has_been_out_of_sight_for_long():
    """The kit is covered while a box is picked; the tree asks only where the box is in the hand."""
    cell = IdealCell(parse_tree("Sequence(pick(YellowBox), place(YellowBox, (0, 0, 0.055), KittingBox))"))
    cell.skills.polls = 40
    cell.on_tick = lambda shown: cell.hide.add("KittingBox")
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert "cannot be carried out" in outcome.reason
    assert outcome.reason.endswith("KittingBox is not seen")
    assert 10.0 < outcome.seconds < 20.0


def test_nothing_is_begun_for_a_place_in_a_frame_that_has_been_out_of_sight_for_long():
    """The kit is covered while a box is picked; whether the other one stands in it cannot be known."""
    place = "(YellowBox, (0, 0, 0.055), KittingBox)"
    cell = IdealCell(parse_tree(f"Fallback(at{place}, Sequence(pick(GreenBox), open_gripper))"))
    cell.skills.polls = 40
    cell.on_tick = lambda shown: cell.hide.add("KittingBox")
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert outcome.reason == "there is no use in open_gripper: KittingBox is not seen"
    assert 10.0 < outcome.seconds < 20.0


def test_an_action_that_is_halted_since_it_is_done_was_not_broken_off(tmp_path):
    """Fingers count as open before they have moved all the way."""
    tree = parse_tree("Sequence(Fallback(gripper(open), open_gripper), holding(YellowBox))")
    with Log(tmp_path / "log.jsonl") as log:
        cell = IdealCell(tree, limits=Limits(run=15.0), log=log)
        cell.skills.polls = 10**6

        def turn(shown):
            opened = np.array([len(cell.shown) // 12 % 2 == 1])
            cell.skills.world = dataclasses.replace(cell.skills.world, gripper_open=opened)

        cell.on_tick = turn
        outcome = cell.executor.run()
    assert "the time is up" in outcome.reason
    events = [entry["event"] for entry in read_log(tmp_path / "log.jsonl") if entry["kind"] == "action"]
    assert events.count("DONE") > 5
    assert "CANCELLED" not in events[:-1]
