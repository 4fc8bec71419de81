"""Whole runs on the twin in which something goes wrong: the arms hold or the work is redone, and the log says why."""

import dataclasses
import os
import signal

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import Behavior, expand
from bt_jax.deploy.commands.replay import replay
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import Exit, Limits
from bt_jax.deploy.link.rws import GRIP_TARGET, Rws, symbol
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.run import run_twin
from bt_jax.deploy.twin.settings import Realism
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import load_task

pytestmark = pytest.mark.slow
TASK = dataclasses.replace(load_task("yumi_stack"), targets=load_task("yumi_stack").targets[:1])
MOVE = "move(YellowBox, (0, 0, 0.021), KittingBox)"


class Twin:
    """A run with a fault: `strike(twin, moment)` is called at every tick until it gives True."""

    def __init__(self, strike, tmp_path, *, tree=MOVE, seconds=150.0):
        self.strike, self.done, self.held = strike, False, None
        self.log = tmp_path / "log.jsonl"
        self.run = run_twin(
            YUMI,
            Program(TASK, parse_tree(tree)),
            3,
            log=self.log,
            limits=Limits(run=seconds),
            on_tick=self.tick,
            prepare=self.prepare,
            realism=Realism.perfect(),
        )
        self.entries = list(read_log(self.log))
        self.end = self.entries[-1]

    def prepare(self, controller, perception):
        self.controller, self.perception = controller, perception

    def tick(self, moment):
        self.moment = moment
        if not self.done:
            self.done, self.struck = bool(self.strike(self, moment)), moment.shown.seen.time

    def attempts(self, action):
        return [e["event"] for e in self.entries if e["kind"] == "action" and e["action"].startswith(action)]


def when_moving(fault):
    """Strikes while an arm is on its way."""

    def strike(twin, moment):
        if moment.shown.phase != "acting" or moment.shown.seen.time < 3.0:
            return False
        fault(twin)
        return True

    return strike


@pytest.mark.parametrize(
    ("fault", "code", "word"),
    [
        (lambda twin: twin.perception.camera.freeze(), Exit.STOPPED, "camera"),
        (lambda twin: twin.perception.camera.lose(), Exit.STOPPED, "camera"),
        (lambda twin: twin.controller.kill(), Exit.STOPPED, "ended"),
        (lambda twin: twin.controller.fault("motors_off"), Exit.STOPPED, "not running"),
        (lambda twin: twin.controller.fault("emergency_stop"), Exit.STOPPED, "not running"),
        (lambda twin: os.kill(os.getpid(), signal.SIGINT), Exit.INTERRUPTED, "interrupted"),
    ],
    ids=["camera frozen", "camera lost", "controller killed", "motors off", "emergency stop", "Ctrl-C"],
)
def test_the_arms_hold_and_the_log_says_why(tmp_path, fault, code, word):
    twin = Twin(when_moving(fault), tmp_path)
    assert twin.done
    assert twin.run.exit_code == twin.end["exit_code"] == code
    assert word in twin.end["reason"]
    if word != "ended":
        for arm in ("left", "right"):
            motion = [entry for entry in twin.entries if entry["kind"] == "motion" and entry["arm"] == arm]
            times = np.concatenate([entry["time"] for entry in motion])
            setpoints = np.concatenate([entry["setpoint"] for entry in motion])
            if word == "not running":  # the run ends at its next tick, on a busy machine before they come to rest
                speeds = np.abs(np.diff(setpoints, axis=0)) / np.diff(times)[:, None]
                assert np.all(speeds <= YUMI.arm(arm).speed * 1.01), "no setpoint jumps"
            else:
                assert np.ptp(setpoints[times >= times[-10]], axis=0).max() < 1e-6, "the last setpoints hold"
    assert all(tick.same for tick in replay(twin.log))


def test_a_bad_network_does_not_keep_the_work_from_being_done(tmp_path):
    def strike(twin, moment):
        twin.controller.fault("drop", share=0.03)
        twin.controller.fault("reorder", share=0.03)
        return True

    twin = Twin(strike, tmp_path)
    assert twin.run.outcome.exit_code == Exit.DONE
    assert twin.run.counters.lost > 0
    assert twin.run.counters.reordered > 0


def test_a_dropped_box_is_picked_again(tmp_path):
    def strike(twin, moment):
        seen = moment.shown.seen
        if seen.holding != "YellowBox" or moment.shown.phase != "acting":
            return False
        rws = Rws("127.0.0.1", twin.controller.rws_port, "Default User", "robotics")
        for arm in ("left", "right"):
            rws.set_number(symbol(arm, GRIP_TARGET), 25.0)  # the fingers let go by themselves
        return True

    twin = Twin(strike, tmp_path)
    assert twin.done
    assert twin.run.outcome.exit_code == Exit.DONE, twin.end["reason"]
    assert twin.attempts("pick").count("start") >= 2


BOX = "YellowBox"


class Covers:
    """Covers the markers of the box once `when(moment)` holds, and uncovers them after some seconds where asked for."""

    def __init__(self, when, *, seconds=np.inf):
        self.when, self.seconds, self.since = when, seconds, None

    def __call__(self, twin, moment):
        now = moment.shown.seen.time
        if self.since is None and self.when(moment.shown):
            self.since = now
            twin.perception.camera.cover(BOX)
        if self.since is not None and now - self.since > self.seconds:
            twin.perception.camera.uncover(BOX)
            return True
        return False


def unseen_ticks(twin, since):
    """Those in which the box was asked for, neither seen nor held, from a second after it was covered."""
    nodes = prefix(expand(parse_tree(twin.entries[0]["tree"])))
    spatial = [
        i
        for i, node in enumerate(nodes)
        if isinstance(node, Behavior) and node.name in ("at", "reachable", "clear") and BOX in (node.object, node.frame)
    ]
    for entry in twin.entries:
        if entry["kind"] != "tick" or entry["statuses"] is None or entry["seen"]["time"] < since + 1.2:
            continue
        if BOX not in entry["seen"]["poses"] and entry["seen"]["holding"] != BOX:
            yield entry, [entry["statuses"][i] for i in spatial]


def check_that_unknown_is_never_true(twin, since):
    found = list(unseen_ticks(twin, since))
    assert found, "the box was covered for long enough"
    assert not any(str(int(Status.SUCCESS)) in statuses for _, statuses in found)
    return found


def test_a_box_whose_markers_are_covered_is_looked_for_and_not_guessed(tmp_path):
    cover = Covers(lambda shown: True)
    twin = Twin(cover, tmp_path)
    assert twin.run.exit_code == twin.end["exit_code"] == Exit.FAILED
    assert twin.end["reason"] == f"the tree has failed: {BOX} is not seen"
    found = check_that_unknown_is_never_true(twin, cover.since)
    assert {"looking"} < {entry["phase"] for entry, _ in found}
    assert not twin.attempts("pick"), "nothing is begun"
    setpoints = np.concatenate([e["setpoint"] for e in twin.entries if e["kind"] == "motion" and e["arm"] == "left"])
    assert np.ptp(setpoints, axis=0).max() < 0.1, "the arms stay at home"


def test_a_box_that_is_covered_once_it_stands_there_is_not_taken_for_placed(tmp_path):
    def let_go(shown):
        return shown.action == place and shown.phase == "committed" and shown.seen.holding is None

    place = next(node for node in prefix(expand(parse_tree(MOVE))) if str(node).startswith("place("))
    cover = Covers(let_go)
    twin = Twin(cover, tmp_path)
    assert cover.since is not None
    assert twin.run.distances[0] < TASK.episode.tolerance, "in truth it stands where it should"
    assert twin.run.exit_code == Exit.FAILED
    assert f"{BOX}" in twin.end["reason"]
    assert "not seen" in twin.end["reason"]
    found = check_that_unknown_is_never_true(twin, cover.since)
    assert "looking" in {entry["phase"] for entry, _ in found}
    motion = [entry for entry in twin.entries if entry["kind"] == "motion"][-2:]
    assert all(np.ptp(entry["setpoint"], axis=0).max() < 1e-9 for entry in motion), "the arms hold"


def test_a_box_that_is_uncovered_again_is_worked_with(tmp_path):
    cover = Covers(lambda shown: True, seconds=8.0)
    twin = Twin(cover, tmp_path)
    assert twin.done
    check_that_unknown_is_never_true(twin, cover.since)
    assert twin.run.outcome.exit_code == Exit.DONE, twin.end["reason"]


def test_a_grasp_that_closes_on_nothing_is_tried_again(tmp_path):
    """The box is gone from between the fingers in the moment they begin to close, and lies elsewhere."""

    def strike(twin, moment):
        if moment.shown.phase != "committed":
            return False
        twin.controller.put("YellowBox", RigidTransform.from_translation([0.3, 0.24, 0.02]))
        return True

    twin = Twin(strike, tmp_path)
    assert twin.run.outcome.exit_code == Exit.DONE
    assert twin.run.distances[0] < 0.005
    assert twin.attempts("pick")[:3] == ["start", "FAILURE", "start"]
    reasons = [e["reason"] for e in twin.entries if e["kind"] == "action" and e["event"] == "FAILURE"]
    assert any("closed on nothing" in reason for reason in reasons)


def test_a_place_out_of_reach_fails_and_says_so(tmp_path):
    twin = Twin(lambda twin, moment: True, tmp_path, tree="move(YellowBox, (1.5, 0, 0.3), base_link)")
    assert twin.run.exit_code == Exit.FAILED
    assert "place(YellowBox" in twin.end["reason"]
    assert twin.attempts("place").count("FAILURE") == TASK.episode.action_ticks
    reasons = {e["reason"] for e in twin.entries if e["kind"] == "action" and e["event"] == "FAILURE"}
    assert all(reasons)
