import dataclasses
import random
import threading

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control
from bt_jax.deploy.commands.replay import replay
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.settings import SIMULATED_TICK, Exit, Limits
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.status import Status
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.tasks import load_task
from tests.helpers.ideal import SEMANTICS, SETTLER, STACK3, TASK, IdealCell

PICK = {name: Behavior("pick", (name,)) for name in TASK.object_names}


def random_tree(rng, leaves, depth=2):
    if depth == 0 or rng.random() < 0.3:
        return rng.choice(leaves)
    kind = rng.choice((Control.sequence, Control.sequence, Control.fallback))
    return kind(*(random_tree(rng, leaves, depth - 1) for _ in range(rng.randint(1, 3))))


def test_does_what_the_simulation_does():
    rng = random.Random(1)
    solved = 0
    for seed in range(16):
        tree = STACK3 if seed < 3 else random_tree(rng, SEMANTICS.vocabulary.leaves)
        cell = IdealCell(tree, seed=seed, limits=Limits(run=12.0, patience=1.0))
        expected = play(SEMANTICS, SETTLER, tree, cell.skills.world)
        commands = [tick.command for tick in expected.ticks if tick.command is not None]
        outcome = cell.executor.run()
        count = min(len(commands), len(cell.skills.started), 9)
        assert cell.skills.started[:count] == commands[:count]
        if expected.ticks[-1].status == Status.SUCCESS:
            assert outcome.exit_code == Exit.DONE
            assert cell.skills.started == commands
            solved += 1
        elif len(commands) < 9 and expected.ticks[-1].status == Status.FAILURE:
            assert outcome.exit_code == Exit.FAILED
    assert 3 < solved < 16


@pytest.mark.parametrize("rule", ["seen", "ticked"])
def test_a_subgoal_stays_reached_while_the_tree_undoes_it(rule):
    task = dataclasses.replace(load_task("restack"), subgoal_reward=rule)
    tree = parse_tree("""
    Fallback
      Sequence
        reached(unstacked)
        move(YellowBox, (0, 0, 0.055), KittingBox)
        move(GreenBox, (0, 0, 0.1), YellowBox)
        move(BlueBox, (0, 0, 0.1), GreenBox)
      Sequence
        move(GreenBox, (0, 0.133, 0.055), KittingBox)
        move(BlueBox, (0, -0.12, 0), YellowBox)
    """)
    cell = IdealCell(tree, task=task)
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.DONE
    commands = [str(action).partition(",")[0] for action in cell.skills.started if action.name == "place"]
    assert commands == [f"place({name}Box" for name in ("Green", "Blue", "Yellow", "Green", "Blue")]


def test_redoes_what_a_person_undoes():
    cell = IdealCell()
    done = []

    def undo(shown):
        if len(cell.skills.started) == 4 and not done:
            done.append(shown.seen.time)
            cell.move("YellowBox", (1.3, 0.2, 0.8))

    cell.on_tick = undo
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.DONE
    assert done
    assert cell.skills.started.count(PICK["YellowBox"]) == 2
    assert play(SEMANTICS, SETTLER, STACK3, cell.skills.world).solved


def test_an_attempt_is_broken_off_when_the_tree_wants_something_else():
    cell = IdealCell()
    goal = cell.skills.world.kits[0, 0] + np.array([0, 0, 0.055])

    def help_out(shown):
        if shown.phase == "acting" and cell.skills.action == PICK["YellowBox"]:
            cell.move("YellowBox", goal)

    cell.on_tick = help_out
    assert cell.executor.run().exit_code == Exit.DONE
    assert cell.skills.cancelled[0] == PICK["YellowBox"]
    assert Behavior("place", STACK3.children[0].args) not in cell.skills.started


def test_a_tree_that_believes_what_is_not_so_has_failed(tmp_path):
    with Log(tmp_path / "log.jsonl") as log:
        outcome = IdealCell(log=log, verify=lambda: "YellowBox is a picture").executor.run()
    assert (outcome.exit_code, outcome.status) == (Exit.FAILED, Status.SUCCESS)
    end = list(read_log(tmp_path / "log.jsonl"))[-1]
    assert end["exit_code"] == Exit.FAILED
    assert end["reason"] == "the tree has succeeded, but YellowBox is a picture"


def test_a_committed_phase_is_not_broken_off():
    cell = IdealCell()
    goal = cell.skills.world.kits[0, 0] + np.array([0, 0, 0.055])
    cell.skills.committed = True
    cell.on_tick = lambda shown: cell.move("YellowBox", goal) if len(cell.skills.started) == 1 else None
    assert cell.executor.run().exit_code == Exit.DONE
    assert not [action for action in cell.skills.cancelled if action is not None]
    assert any(shown.phase == "committed" and shown.statuses is None for shown in cell.shown)


def test_what_is_not_seen_is_looked_for_before_anything_is_done():
    cell = IdealCell()
    cell.hide.add("YellowBox")

    def uncover(shown):
        if cell.skills.looks:
            cell.hide.clear()

    cell.on_tick = uncover
    assert cell.executor.run().exit_code == Exit.DONE
    assert cell.shown[0].phase == "looking"
    assert cell.skills.started[0] == PICK["YellowBox"]


def test_a_tree_that_looks_goes_on_once_the_object_is_seen():
    cell = IdealCell(parse_tree("Sequence(look(YellowBox), retry(3, move(YellowBox, (0, 0, 0.055), KittingBox)))"))
    cell.hide.add("YellowBox")
    cell.on_tick = lambda shown: cell.hide.clear() if shown.seen.time > 1 else None
    assert cell.executor.run().exit_code == Exit.DONE
    assert [action.name for action in cell.skills.started] == ["look", "pick", "place"]
    assert cell.shown[-1].seen.time > 1 + Limits().success, "it must have succeeded for a while"


def test_what_an_arm_hides_is_not_looked_for_before_it_has_acted():
    cell = IdealCell(parse_tree("Sequence(look(YellowBox), move(YellowBox, (0, 0, 0.055), KittingBox))"))

    def hide(shown):
        cell.hide.clear()
        if cell.skills.action == PICK["YellowBox"] and shown.phase in ("starting", "acting", "acting unseen"):
            cell.hide.add("YellowBox")

    cell.on_tick = hide
    assert cell.executor.run().exit_code == Exit.DONE
    assert any(shown.phase == "acting unseen" for shown in cell.shown)
    assert [action.name for action in cell.skills.started] == ["pick", "place"]


def test_a_timeout_counts_ticks_of_the_simulation():
    """However often the robot ticks."""
    cell = IdealCell(parse_tree("Sequence(timeout(2, look(YellowBox)), close_gripper)"))
    cell.skills.polls = 10**6
    cell.hide.add("YellowBox")
    assert cell.executor.run().exit_code == Exit.FAILED
    failed = next(shown for shown in cell.shown if shown.statuses and shown.statuses[1] == Status.FAILURE)
    assert failed.seen.time == pytest.approx(2 * SIMULATED_TICK - 0.1)


def test_a_box_is_not_picked_from_under_one_that_is_out_of_sight_for_a_moment():
    cell = IdealCell(PICK["YellowBox"], limits=Limits(patience=1.0))
    yellow = cell.skills.world.poses[0, TASK.object_names.index("YellowBox"), :3]
    cell.move("GreenBox", yellow + np.array([0, 0, 0.1]))

    def hide(shown):
        cell.hide = set() if cell.skills.looks else {"GreenBox"}

    cell.on_tick = hide
    assert cell.executor.run().exit_code == Exit.FAILED
    assert cell.skills.looks
    assert not cell.skills.started


def test_hiding_a_box_does_not_break_off_an_attempt_at_another():
    cell = IdealCell()

    def hide(shown):
        cell.hide = {"YellowBox"} if shown.phase in ("acting", "acting unseen") else set()

    cell.on_tick = hide
    assert cell.executor.run().exit_code == Exit.DONE
    assert "acting unseen" in {shown.phase for shown in cell.shown}
    assert not [action for action in cell.skills.cancelled if action is not None]


def test_a_box_that_never_comes_fails_and_says_so():
    cell = IdealCell()
    cell.hide.add("BlueBox")
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.status) == (Exit.FAILED, Status.FAILURE)
    assert "BlueBox" in outcome.reason
    assert PICK["BlueBox"] not in cell.skills.started
    assert cell.link.stopped() is None


def test_a_box_out_of_reach_fails_and_says_so():
    cell = IdealCell()
    cell.skills.out_of_reach.add("GreenBox")
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert "GreenBox is out of reach" in outcome.reason
    assert PICK["GreenBox"] not in cell.skills.started


def test_retries_are_bounded(monkeypatch):
    cell = IdealCell(Control.sequence(PICK["YellowBox"], Behavior("open_gripper")))
    monkeypatch.setattr(cell.skills, "poll", lambda seen: Status.FAILURE)
    cell.skills.reason = "the fingers closed on nothing"
    outcome = cell.executor.run()
    assert cell.skills.started == [PICK["YellowBox"]] * TASK.episode.action_ticks
    assert outcome.exit_code == Exit.FAILED
    assert "pick(YellowBox) failed 5 times (the fingers closed on nothing)" in outcome.reason


def test_an_attempt_has_a_time_out(tmp_path):
    log = Log(tmp_path / "log.jsonl")
    cell = IdealCell(limits=Limits(action=2.0), log=log)
    cell.skills.polls = 10**6
    outcome = cell.executor.run()
    log.close()
    assert outcome.exit_code == Exit.FAILED
    events = [entry for entry in read_log(tmp_path / "log.jsonl") if entry["kind"] == "action"]
    assert sum(entry["event"] == "TIMEOUT" for entry in events) == TASK.episode.action_ticks


def test_a_run_that_fails_during_a_look_brings_the_arms_to_rest_first():
    """A box is looked for, seen at last and found out of reach, while the arms are still on their way home."""
    cell = IdealCell(Control.sequence(PICK["YellowBox"], Behavior("open_gripper")), limits=Limits(patience=1.0))
    cell.skills.polls = 10**6
    cell.hide.add("YellowBox")
    cell.skills.out_of_reach.add("YellowBox")
    cell.on_tick = lambda shown: cell.hide.clear() if cell.skills.looks else None
    cancel = cell.skills.cancel
    cancelled = []
    cell.skills.cancel = lambda: (cancel(), cancelled.append(cell.link.time))
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert "out of reach" in outcome.reason
    assert cell.skills.cancelled == [None], "the look was under way"
    assert cell.link.time >= cancelled[0] + Limits().rest


def test_a_run_has_a_time_limit():
    cell = IdealCell(limits=Limits(run=1.0))
    cell.skills.polls = 10**6
    outcome = cell.executor.run()
    assert outcome.exit_code == Exit.FAILED
    assert "time is up" in outcome.reason
    assert cell.skills.cancelled == [PICK["YellowBox"]]


def test_slow_ticks_are_counted():
    cell = IdealCell(PICK["YellowBox"])
    look = cell.executor.observe

    def slow():
        cell.link.time += 0.12 if len(cell.shown) % 2 else 0.05
        return look()

    cell.executor.observe = slow
    outcome = cell.executor.run()
    assert outcome.overruns == outcome.ticks // 2 > 0


def test_runs_in_a_thread_too():
    cell = IdealCell()
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(cell.executor.run()))
    thread.start()
    thread.join()
    assert outcomes[0].exit_code == Exit.DONE


def test_a_dry_run_starts_nothing(tmp_path):
    log = Log(tmp_path / "log.jsonl")
    cell = IdealCell(limits=Limits(run=5.0), dry=True, log=log)
    cell.skills.start = lambda action, seen: cell.skills.started.append(action)
    cell.skills.poll = lambda seen: Status.RUNNING
    cell.executor.run()
    log.close()
    assert cell.skills.started == [PICK["YellowBox"]]
    assert {shown.phase for shown in cell.shown} == {"would start pick(YellowBox)"}
    assert cell.skills.cancelled


def test_boxes_are_asked_for_reach_only_where_they_moved():
    cell = IdealCell()
    asked = []
    cell.skills.reachable = lambda name, seen: asked.append(name) is None
    cell.executor.run()
    assert len(asked) <= 6 * len(TASK.object_names) < cell.executor.ticks


def test_a_run_whose_clock_has_died_is_stopped_and_logged(tmp_path):
    with Log(tmp_path / "log.jsonl") as log:
        cell = IdealCell(log=log)

        def die():
            raise UserError("a process of the robot's link ended; start the run again")

        def strike(shown):
            if shown.seen.time > 1.0:
                cell.link.now = die

        cell.on_tick = strike
        outcome = cell.executor.run()
    assert outcome.exit_code == Exit.STOPPED
    assert outcome.seconds == cell.shown[-1].seen.time
    end = list(read_log(log.path))[-1]
    assert (end["kind"], end["exit_code"]) == ("end", Exit.STOPPED)
    assert "link ended" in end["reason"]


STEPS = "pick(YellowBox), place(YellowBox, (0, 0, 0.055), KittingBox)"


def test_steps_with_memory_are_done_once_and_replay_the_same(tmp_path):
    path = tmp_path / "log.jsonl"
    with Log(path) as log:
        cell = IdealCell(parse_tree(f"Sequence(Inverter(gripper(closed)), ResumingSequence({STEPS}))"), log=log)
        outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.status) == (
        Exit.FAILED,
        Status.FAILURE,
    )  # the gripper is closed once it holds the box
    with Log(tmp_path / "again.jsonl") as log:
        cell = IdealCell(parse_tree(f"RetryUntilSuccessful(2, ResumingSequence({STEPS}))"), log=log)
        outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.reason) == (Exit.DONE, "the tree has succeeded")
    assert [action.name for action in cell.skills.started] == ["pick", "place"]
    assert all(tick.same for one in (path, tmp_path / "again.jsonl") for tick in replay(one))


def test_a_timeout_breaks_an_attempt_off_and_ends_the_run():
    cell = IdealCell(parse_tree(f"Timeout(300, ResumingSequence({STEPS}))"), limits=Limits(patience=1000.0))
    cell.skills.polls = 100
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.status) == (Exit.FAILED, Status.FAILURE)
    assert cell.skills.cancelled == [PICK["YellowBox"]]
    assert outcome.seconds < 10.0


@pytest.mark.parametrize(
    "text",
    [
        "ForceSuccess(Timeout(300, pick(YellowBox)))",
        "Inverter(Timeout(300, pick(YellowBox)))",
        "Sequence(ForceSuccess(Timeout(300, pick(YellowBox))), gripper(open))",
    ],
)
def test_a_tree_that_succeeds_during_an_attempt_brings_the_arms_to_rest_first(text):
    verified = []
    cell = IdealCell(parse_tree(text), verify=lambda: verified.append(cell.link.time) or "")
    cell.skills.polls = 100
    cancel, cancelled = cell.skills.cancel, []
    cell.skills.cancel = lambda: (cancel(), cancelled.append(cell.link.time))
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.reason) == (Exit.DONE, "the tree has succeeded")
    assert cell.skills.cancelled == [PICK["YellowBox"]]
    assert cell.executor.runner.action is None
    assert verified[0] >= cancelled[0] + Limits().rest, "the scene is looked at once the arms rest"


def test_a_robot_that_is_stopped_while_its_arms_come_to_rest_has_not_succeeded():
    cell = IdealCell(parse_tree("ForceSuccess(Timeout(300, pick(YellowBox)))"))
    cell.skills.polls = 100
    cancel = cell.skills.cancel
    cell.skills.cancel = lambda: (cancel(), cell.link.stop("left: no feedback"))
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.reason) == (Exit.STOPPED, "left: no feedback")


def test_a_stop_says_what_was_being_done():
    cell = IdealCell(PICK["YellowBox"])
    cell.skills.polls = 100
    cell.on_tick = lambda shown: cell.link.stop("left: it met something") if shown.phase == "acting" else None
    assert cell.executor.run().reason == "left: it met something, during pick(YellowBox)"


def test_what_is_not_seen_uses_no_attempt_up():
    tree = parse_tree("RetryUntilSuccessful(2, Sequence(reachable(YellowBox), pick(YellowBox)))")
    cell = IdealCell(tree)
    cell.hide.add("YellowBox")
    cell.on_tick = lambda shown: cell.hide.clear() if len(cell.shown) > 5 else None
    assert cell.executor.run().exit_code == Exit.DONE
