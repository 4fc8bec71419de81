import io
import json

import numpy as np
import pytest
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior
from bt_jax.commands.check import described
from bt_jax.deploy.commands import replay as replay_module
from bt_jax.deploy.commands.arguments import ReplayArguments
from bt_jax.deploy.commands.replay import replay, replay_command
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import log_ends, read_log
from bt_jax.deploy.execution.settings import Exit
from bt_jax.encoding.formats.text import parse_tree
from tests.helpers.ideal import TASK, IdealCell


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The log of a run in which a box was hidden for a while and another was moved."""
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    with Log(path) as log:
        cell = IdealCell(log=log)

        def disturb(shown):
            cell.hide = {"GreenBox"} if 30 < len(cell.shown) < 40 else set()
            if len(cell.shown) == 15:
                cell.move("YellowBox", (1.3, 0.2, 0.8))

        cell.on_tick = disturb
        cell.executor.run()
    return path


def test_a_log_replays_as_it_was(written):
    ticks = list(replay(written))
    assert len(ticks) > 30
    assert all(tick.same for tick in ticks)
    assert len({tick.statuses for tick in ticks}) > 5


@pytest.fixture(scope="module")
def looked(tmp_path_factory):
    """The log of a run that looks for a box, which may stand on the one that is to be picked, and finds it elsewhere."""
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    with Log(path) as log:
        cell = IdealCell(Behavior("pick", ("YellowBox",)), log=log)
        away = cell.skills.world.poses[0, TASK.object_names.index("GreenBox"), :3].copy()
        cell.move("GreenBox", cell.skills.world.poses[0, TASK.object_names.index("YellowBox"), :3] + [0, 0, 0.1])

        def hide(report):
            cell.hide = {"GreenBox"} if len(cell.shown) in range(1, 60) else set()
            if len(cell.shown) == 3:
                cell.move("GreenBox", away)

        cell.on_tick = hide
        assert cell.executor.run().exit_code == Exit.DONE
    return path


def changed(path, target, change):
    """The log with `change(entry)` applied to each tick."""
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    for entry in entries:
        if entry["kind"] == "tick":
            change(entry)
    target.write_text("\n".join(map(json.dumps, entries)))
    return target


def test_a_look_replays_as_it_was(looked, tmp_path):
    ticks = list(replay(looked))
    assert {"looking", "starting"} <= {tick.phase for tick in ticks}
    assert all(tick.same for tick in ticks)

    def lift(entry):
        for pose in entry["context"]["last"].values():
            pose[2] += 1.0

    elsewhere = changed(looked, tmp_path / "elsewhere.jsonl", lift)
    assert not all(tick.same for tick in replay(elsewhere)), "where things were seen last has a say in it"
    fresh = changed(looked, tmp_path / "fresh.jsonl", lambda entry: entry["sight"].update(looked=None))
    assert not all(tick.same for tick in replay(fresh)), "and so has the time since the last look"


def test_an_older_log_replays_by_its_statuses(looked, tmp_path):
    def age(entry):
        del entry["sight"], entry["time"], entry["context"]["last"]

    ticks = list(replay(changed(looked, tmp_path / "old.jsonl", age)))
    assert len(ticks) > 30
    assert all(tick.same and tick.phase is None for tick in ticks)


def test_the_ends_of_a_log_are_read_without_its_middle(written, tmp_path):
    entries = list(read_log(written))
    assert log_ends(written) == (entries[0], entries[-1])
    first, *_, last = written.read_text().splitlines()
    long = tmp_path / "long.jsonl"
    long.write_text("\n".join([first, "x" * 10**6, last, '{"kind": "unfin']))
    assert log_ends(long)[1] == entries[-1], "a last line that was not finished is left out"
    long.write_text(first + "\n")
    assert log_ends(long) == (entries[0], entries[0])
    long.write_text("")
    with pytest.raises(UserError, match="is empty"):
        log_ends(long)
    long.write_text("hello\n")
    with pytest.raises(UserError, match="no log"):
        log_ends(long)


def test_a_log_says_what_was_run(written):
    entries = list(read_log(written))
    start, end = entries[0], entries[-1]
    assert {"tree", "digest", "task", "limits", "settings", "versions"} <= set(start)
    assert start["versions"]["mujoco"]
    assert end["kind"] == "end"
    assert end["exit_code"] == 0
    events = [(entry["action"], entry["event"]) for entry in entries if entry["kind"] == "action"]
    assert events[0] == ("pick(YellowBox)", "start")
    assert ("pick(YellowBox)", "SUCCESS") in events


def test_the_command_tells_the_story(written):
    console = Console(record=True, width=120, file=io.StringIO())
    assert replay_command(ReplayArguments(written), console) == 0
    text = console.export_text()
    assert "pick(YellowBox) SUCCESS" in text
    assert "the tree has succeeded" in text
    assert "decided as they were" in text


def test_another_decision_is_noticed(written, tmp_path):
    lines = written.read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if json.loads(line)["kind"] == "tick")
    entry = json.loads(lines[index])
    entry["seen"]["holding"] = "YellowBox"
    lines[index] = json.dumps(entry)
    changed = tmp_path / "changed.jsonl"
    changed.write_text("\n".join(lines))
    assert [tick.same for tick in replay(changed)].count(False) == 1
    assert replay_command(ReplayArguments(changed), Console(file=io.StringIO())) == 1


def test_a_log_that_breaks_off_is_read_up_to_there(written, tmp_path):
    text = written.read_text()
    broken = tmp_path / "broken.jsonl"
    middle = len(text) // 2
    for end in (middle, text.index("}", middle) + 1):  # also behind what looks like the end of a line
        broken.write_text(text[:end])
        assert 0 < len(list(replay(broken))) < len(list(replay(written)))
    console = Console(record=True, width=120, file=io.StringIO())
    replay_command(ReplayArguments(broken), console)
    assert "breaks off" in console.export_text()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda line: line[:40],
        lambda line: "[" * 3000,
        lambda line: "",
        lambda line: "[]",
        lambda line: line.replace('"phase"', '"phrase"'),
        lambda line: line.replace('"time": ', '"time": 1e999, "was": '),
        lambda line: line.replace('"statuses": "', '"statuses": "7'),
        lambda line: line.replace('"statuses": "', '"statuses": ".'),
        lambda line: line.replace('"seen": {', '"seen": 5, "then": {'),
        lambda line: line.replace('"poses": {"YellowBox": [', '"poses": {"YellowBox": [0, 0, 0, 0, 0, 0, 0], "Old": ['),
        lambda line: line.replace('"attempt": ', '"attempt": "fly(YellowBox)", "was": '),
        lambda line: line.encode().replace(b'"tick"', b'"t\xffck"').decode("latin-1"),
    ],
)
def test_a_damaged_line_is_told_and_hides_no_other(written, tmp_path, spoil):
    lines = written.read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if i > 20 and '"statuses": "' in line)
    good, damaged = lines[index], tmp_path / "damaged.jsonl"
    lines[index] = spoil(good)
    assert lines[index] != good
    damaged.write_text("\n".join(lines), encoding="latin-1")
    console = Console(record=True, width=120, file=io.StringIO())
    assert replay_command(ReplayArguments(damaged), console) == 0
    text = console.export_text()
    assert f"damaged    line {index + 1}: left out" in text
    count = len(list(replay(written))) - 1
    assert f"{count} ticks, {count} decided as they were" in text
    with pytest.raises(UserError, match=f"line {index + 1} is not part of a log"):
        list(replay(damaged))


@pytest.mark.parametrize("tail", ["[" * 100_000, '{"kind": "x", "a": ' + "[" * 100_000, '{"kind": "end"', "\\"])
def test_a_last_line_that_was_not_finished_is_left_out(written, tmp_path, tail):
    path = tmp_path / "log.jsonl"
    path.write_text(written.read_text() + tail)
    assert list(read_log(path)) == list(read_log(written))


@pytest.fixture(scope="module")
def remembering(tmp_path_factory):
    """The log of a run whose tree has memory."""
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    with Log(path) as log:
        steps = "pick(YellowBox), place(YellowBox, (0, 0, 0.055), KittingBox), pick(GreenBox)"
        assert IdealCell(parse_tree(f"ResumingSequence({steps})"), log=log).executor.run().exit_code == Exit.DONE
    return path


def told(path) -> tuple[int, str]:
    """The exit code of `replay`, and what it prints."""
    console = Console(record=True, width=200, file=io.StringIO())
    return replay_command(ReplayArguments(path), console), console.export_text()


def test_what_follows_a_damaged_line_is_not_compared_where_the_tree_has_memory(remembering, tmp_path):
    lines, path = remembering.read_text().splitlines(), tmp_path / "log.jsonl"
    ticks = [i for i, line in enumerate(lines) if '"statuses": "' in line]
    count = len(ticks)
    assert f"{count} ticks, {count} decided as they were" in told(remembering)[1]
    for place in range(1, count):
        path.write_text("\n".join([*lines[: ticks[place]], "[]", *lines[ticks[place] + 1 :]]))
        code, text = told(path)
        assert code == 0
        assert f"damaged    line {ticks[place] + 1}: left out" in text
        assert f"{place} ticks, {place} decided as they were" in text
        assert (f"{count - place - 1} ticks after line {ticks[place] + 1}: not comparable" in text) == (
            place < count - 1
        )


@pytest.mark.parametrize("log", ["written", "remembering"])
def test_a_log_of_which_nothing_can_be_replayed_is_refused(log, tmp_path, request):
    path = tmp_path / "log.jsonl"
    path.write_text(request.getfixturevalue(log).read_text().replace('"phase"', '"phrase"'))
    with pytest.raises(UserError, match=r"no tick of .*log.jsonl can be replayed"):
        told(path)


def test_a_defect_of_the_program_does_not_read_as_a_damaged_line(written, monkeypatch):
    def broken(*_, **__):
        raise KeyError("no such node")

    monkeypatch.setattr(replay_module, "decide", broken)
    with pytest.raises(KeyError, match="no such node"):
        told(written)


def test_a_tree_that_was_changed_is_refused(written, tmp_path):
    changed = tmp_path / "changed.jsonl"
    changed.write_text(written.read_text().replace("move(BlueBox, (0, 0, 0.1)", "move(BlueBox, (0, 0, 0.2)", 1))
    with pytest.raises(UserError, match="digest"):
        list(replay(changed))


@pytest.mark.parametrize("text", ["", "hello", '{"kind": "tick"}', '{"kind": "start", "format": 99}'])
def test_what_is_no_log_is_refused(tmp_path, text):
    path = tmp_path / "log.jsonl"
    path.write_text(text)
    with pytest.raises(UserError, match=r"log|empty"):
        list(read_log(path))
    with pytest.raises(UserError, match="there is no file"):
        list(read_log(tmp_path / "nowhere.jsonl"))


def test_a_log_is_never_overwritten(tmp_path):
    path = tmp_path / "log.jsonl"
    with Log(path) as log:
        log.write("start", format=1)
    with pytest.raises(UserError, match="exists"):
        Log(path)


def test_motion_is_thinned_by_cycle_and_keeps_arms_apart(tmp_path):
    records = np.zeros((20, 17))
    records[:, 0] = np.tile([0, 1], 10)
    records[:, 16] = np.repeat(np.arange(10), 2)
    records[:, 2:9] = records[:, :1] + 0.5
    with Log(tmp_path / "log.jsonl") as log:
        log.write("start", format=1)
        log.motion(("left", "right"), records, every=5)
    entries = list(read_log(tmp_path / "log.jsonl"))[1:]
    assert [entry["arm"] for entry in entries] == ["left", "right"]
    assert entries[1]["setpoint"] == [[1.5] * 7] * 2


def test_a_measurement_that_is_no_number_is_null(tmp_path):
    records = np.zeros((1, 17))
    records[:, 9:16] = np.nan
    with Log(tmp_path / "log.jsonl") as log:
        log.write("start", format=1)
        log.motion(("left", "right"), records, every=1)
    assert list(read_log(tmp_path / "log.jsonl"))[1]["measured"] == [[None] * 7]


@pytest.mark.parametrize(("measured", "told"), [([None] * 7, ""), ([None] * 6 + [0.1], "setpoint 5.73 deg")])
def test_a_log_with_unknown_measurements_is_told(written, tmp_path, measured, told):
    entry = {"kind": "motion", "arm": "left", "time": [0.0], "setpoint": [[0.0] * 7], "measured": [measured]}
    *lines, end = written.read_text().splitlines()
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join([*lines, json.dumps(entry), end]))
    console = Console(record=True, width=120, file=io.StringIO())
    assert replay_command(ReplayArguments(path), console) == 0
    text = console.export_text()
    assert ("motion  " in text) == bool(told)
    assert told in text


def test_check_says_what_a_log_is_and_what_is_wrong_with_it(written, tmp_path):
    ticks = sum(entry["kind"] == "tick" for entry in read_log(written))
    assert described(written).startswith(f"log of the robot, task {TASK.name}, {ticks} ticks")
    broken = tmp_path / "broken.jsonl"
    lines = written.read_bytes().splitlines()
    broken.write_bytes(b"\n".join([*lines[:3], b"{}", *lines[3:]]))
    with pytest.raises(UserError, match=r"broken.jsonl, line 4 is not part of a log"):
        described(broken)
