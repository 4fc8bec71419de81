import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.fault_counts import count_faults
from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
KIT = RigidTransform.from_translation([0.3, 0.0, 0.001])
PICK, PLACE = "pick(YellowBox)", "place(YellowBox, (0, 0, 0.022), KittingBox)"


class Story:
    """The lines of a log, written as things happen to YellowBox."""

    def __init__(self):
        self.time, self.lines = 0.0, []
        self.poses = {
            "YellowBox": RigidTransform.from_translation([0.3, 0.24, 0.02]),
            "GreenBox": RigidTransform.from_translation([0.3, -0.24, 0.02]),
            "KittingBox": KIT,
        }
        self.hidden, self.holding = set(), None

    def ticks(self, seconds, attempt=None):
        for _ in range(round(seconds / 0.1)):
            self.time += 0.1
            seen = Observation(
                self.time,
                {name: pose for name, pose in self.poses.items() if name not in self.hidden},
                {"left": 0.05},
                self.holding,
                findings=tuple(Finding(name, f"{name} is not seen", missing=True) for name in self.hidden),
                measured=dict.fromkeys(self.poses, self.time),
            )
            self.lines.append({"kind": "tick", "seen": seen.to_dict(), "context": {"attempt": attempt}})

    def attempt(self, action, event="SUCCESS", fault="", seconds=4.0, **more):
        self.lines.append({"kind": "action", "time": self.time, "action": action, "event": "start", "reason": ""})
        self.ticks(seconds, action)
        end = {"kind": "action", "time": self.time, "action": action, "event": event, "reason": "", "fault": fault}
        self.lines.append({**end, **more})

    def handled(self, fault=""):
        """A pick, then a place that ends so."""
        self.attempt(PICK)
        self.holding = "YellowBox"
        self.ticks(0.5)
        self.attempt(PLACE, "FAILURE" if fault else "SUCCESS", fault)
        self.holding = None

    def counts(self):
        return count_faults(TASK, self.lines)


ATTEMPTS = st.lists(
    st.sampled_from(
        [
            (PICK, "SUCCESS", ""),
            (PICK, "FAILURE", "slip"),
            (PICK, "FAILURE", "jam"),
            (PICK, "FAILURE", ""),
            (PICK, "CANCELLED", ""),
            (PLACE, "SUCCESS", ""),
            (PLACE, "FAILURE", "drop"),
            (PLACE, "FAILURE", "jam"),
            ("open_gripper", "DONE", ""),
        ]
    ),
    max_size=8,
)


@settings(max_examples=10, deadline=None)
@given(ATTEMPTS)
def test_attempts_that_were_carried_out_are_counted_by_how_they_ended(attempts):
    story = Story()
    for action, event, fault in attempts:
        story.attempt(action, event, fault, seconds=0.2)
    story.lines.append({"kind": "action", "time": 0.0, "action": "look", "event": "FAILURE", "reason": ""})
    carried = [each for each in attempts if each[1] in ("SUCCESS", "DONE") or each[2]]
    counts = story.counts()
    faults = [fault for *_, fault in carried]
    assert counts.attempts == len(carried)
    assert counts.picks == sum(action == PICK for action, *_ in carried)
    assert counts.places == sum(action == PLACE for action, *_ in carried)
    assert (counts.slips, counts.drops, counts.jams) == tuple(map(faults.count, ("slip", "drop", "jam")))
    assert (counts.moved, counts.hidden, counts.taken) == (0, (), ())


@settings(max_examples=10, deadline=None)
@given(st.floats(-0.015, 0.015), st.floats(-0.015, 0.015), st.floats(-40, 40), st.floats(-3, 3))
def test_the_error_of_a_place_is_that_in_its_frame(x, y, turn, frame):
    """Of a cube, which looks alike after each quarter, and whichever way the frame is turned."""
    story = Story()
    story.poses["KittingBox"] = kit = RigidTransform.from_components([0.3, 0, 0.001], Rotation.from_euler("z", frame))
    story.handled()
    story.poses["YellowBox"] = kit * RigidTransform.from_components(
        [x, y, 0.022], Rotation.from_euler("z", math.radians(turn + 90))
    )
    story.ticks(2.0)
    counts = story.counts()
    assert counts.errors == (pytest.approx((x, y), abs=1e-9),)
    assert counts.turns == (pytest.approx(turn, abs=1e-6),)
    assert (counts.moved, counts.strays) == (0, 0)


def test_what_does_not_stay_near_its_place_is_no_error_of_a_place():
    story = Story()
    story.handled()
    story.poses["YellowBox"] = KIT * RigidTransform.from_translation([0.08, 0, 0.022])
    story.ticks(2.0)
    counts = story.counts()
    assert (counts.errors, counts.strays) == ((), 1)


@pytest.mark.parametrize(
    ("seconds", "elsewhere", "expected"),
    [(0.0, True, "moved"), (3.0, True, "taken"), (3.0, False, "hidden"), (0.0, False, "")],
)
def test_what_happens_to_an_object_that_nobody_touches(seconds, elsewhere, expected):
    """Out of sight for a while, and then where it was, or elsewhere; or elsewhere at once."""
    story = Story()
    story.ticks(2.0)
    story.attempt(PICK.replace("Yellow", "Green"))
    if seconds:
        story.hidden = {"YellowBox"}
        story.ticks(seconds)
        story.hidden = set()
    if elsewhere:
        story.poses["YellowBox"] = RigidTransform.from_translation([0.35, 0.2, 0.02])
    story.ticks(2.0)
    counts = story.counts()
    found = {"moved": counts.moved, "taken": len(counts.taken), "hidden": len(counts.hidden)}
    assert found == {name: int(name == expected) for name in found}
    assert counts.taken + counts.hidden == pytest.approx([seconds] if seconds else [], abs=0.11)


def test_what_the_robot_moves_itself_no_person_has_moved():
    story = Story()
    story.ticks(1.0)
    for fault in ("", "drop"):
        story.handled(fault)
        story.poses["YellowBox"] = RigidTransform.from_translation([0.35, 0.2 + 0.02 * len(fault), 0.02])
        story.ticks(0.5)
    story.ticks(3.0)
    assert story.counts().moved == 0


def test_counts_of_several_logs_add_up():
    story = Story()
    story.handled()
    story.ticks(2.0)
    counts = story.counts()
    assert (counts + counts).attempts == 2 * counts.attempts
    assert (counts + counts).tick == pytest.approx(counts.tick) == pytest.approx(4.5)
    assert (counts + counts).ticks == pytest.approx(2 * counts.ticks, abs=1)


def test_a_log_that_does_not_say_which_fault_ended_an_attempt_is_refused():
    story = Story()
    story.attempt(PICK, "FAILURE", "slip")
    for line in story.lines:
        line.pop("fault", None)
    with pytest.raises(UserError, match="since an older version wrote it; leave it out"):
        story.counts()
