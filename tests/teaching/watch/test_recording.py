"""From what was watched to the published format, with what a person decides."""

import itertools
import math

import numpy as np
import pytest
import yaml

from bt_jax._util.errors import UserError
from bt_jax.lfd import DemonstrationFolder, Frames, learn
from bt_jax.teaching.watch.recording import demonstration_of
from tests.helpers.watched import IN_KIT, KIT, ON_GREEN, ON_YELLOW, PLACES, TASK, Table, watch
from tests.teaching.watch.test_watcher import both_at_once, bumped, kit_pushed, stacking, taken_away, twice


def recorded(film, *decisions):
    _, watched = watch(film)
    return demonstration_of(watched, decisions or [doubt.usual for doubt in watched.doubts], TASK)


def actions(demonstration):
    return [
        (action.kind, min(TASK.object_names, key=lambda box: np.linalg.norm(action.handled(box))))
        for action in demonstration.actions
    ]


def test_every_frame_has_its_pose_at_every_action():
    one = recorded(stacking(Table()))
    assert len(one.actions) == 6
    for action in one.actions:
        assert set(action.poses) == set(Frames.of(TASK).names) == set(action.sigmas)
        assert all(0 < sigma < 0.002 for sigma in action.sigmas.values())
    places = one.actions[1::2]
    for action, frame, goal in zip(places, (KIT, "YellowBox", "GreenBox"), (0.021, 0.04, 0.04), strict=True):
        assert action.handled(frame) == pytest.approx((0, 0, goal), abs=0.001)
    for action, place in zip(one.actions[::2], list(PLACES.values())[1:], strict=True):
        assert action.handled(TASK.robot_frame) == pytest.approx(place, abs=0.001)
    assert one.actions[3].handled(TASK.robot_frame) == pytest.approx(ON_YELLOW, abs=0.001)
    assert one.actions[5].handled(TASK.robot_frame) == pytest.approx(ON_GREEN, abs=0.001)


def test_it_is_written_and_read_as_any_other_and_says_how_sure_it_is(tmp_path):
    folder = DemonstrationFolder(tmp_path / "demos")
    folder.create(Frames.of(TASK))
    for seed in range(3):
        table = Table(np.random.default_rng(seed))
        for i, name in enumerate(TASK.object_names):
            x, y, z = PLACES[name]
            table.put(name, (x + 0.02 * math.cos(seed + i), y + 0.02 * math.sin(2 * seed + i), z), degrees=50 * seed)
        folder.append(recorded(stacking(table)))
    data = yaml.safe_load((folder.path / "demo1" / "data_2.yaml").read_text())
    assert set(data) == {"type", "vec_pos", "vec_quat", "sigma"}
    assert set(data["sigma"]) == set(data["vec_pos"])
    read = folder.read()
    assert not read.problems
    assert [action.sigmas for action in read.demonstrations[0].actions][1] == data["sigma"]
    lesson = learn(read, TASK)
    assert [(target.object, target.frame) for target in lesson.targets] == [
        (target.object, target.frame) for target in TASK.targets
    ]
    for found, target in zip(lesson.targets, TASK.targets, strict=True):
        assert found.position == pytest.approx(target.position, abs=0.002)


DECIDED = [
    (twice, "keep", [("pick", "BlueBox"), ("place", "BlueBox")] * 2),
    (twice, "leave out", [("pick", "BlueBox"), ("place", "BlueBox")]),
    (bumped, "leave out", [("pick", "YellowBox"), ("place", "YellowBox")]),
    (bumped, "keep", [(kind, box) for box in ("GreenBox", "YellowBox") for kind in ("pick", "place")]),
    (both_at_once, "keep", [(kind, box) for box in ("YellowBox", "GreenBox") for kind in ("pick", "place")]),
    (taken_away, "keep", [("pick", "YellowBox"), ("place", "YellowBox")]),
]


@pytest.mark.parametrize(("film", "decision", "expected"), DECIDED, ids=lambda value: getattr(value, "__name__", None))
def test_a_person_decides(film, decision, expected):
    assert actions(recorded(film(Table()), decision)) == expected


def test_a_box_that_was_bumped_counts_as_where_it_is_then():
    places = [action for action in recorded(bumped(Table())).actions if action.kind == "place"]
    assert places[0].origin("GreenBox", TASK.robot_frame) == pytest.approx((0.339, -0.2, 0.02), abs=0.001)


def test_the_kit_is_never_picked():
    _, watched = watch(kit_pushed(Table()))
    kept = demonstration_of(watched, ["keep"] * len(watched.doubts), TASK)
    assert {box for _, box in actions(kept)} == {"YellowBox"}


REFUSED = {
    "again": (twice, ["again"], "BlueBox was moved twice; show it again"),
    "both left out": (both_at_once, ["leave out"], "nothing was moved"),
    "lost": (taken_away, ["leave out"], "BlueBox has left the view; show it again"),
    "nothing": (lambda table: table.wait(3), [], "nothing was moved; take a box"),
    "never began": (lambda table: iter(()), [], "never seen at rest together"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_kept_is_said(name):
    film, decisions, message = REFUSED[name]
    _, watched = watch(film(Table()))
    with pytest.raises(UserError, match=message):
        demonstration_of(watched, decisions, TASK)


def test_a_move_that_was_cut_off_takes_nothing_from_those_before(tmp_path):
    table = Table()

    def film():
        yield from table.wait(1)
        yield from table.carry("YellowBox", IN_KIT)
        yield from itertools.islice(table.carry("GreenBox", ON_YELLOW), 6)

    _, watched = watch(film())
    assert [doubt.kind for doubt in watched.doubts] == ["lost"]
    assert actions(demonstration_of(watched, ["keep"], TASK)) == [("pick", "YellowBox"), ("place", "YellowBox")]
