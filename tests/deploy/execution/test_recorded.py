import json

import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.recorded import read_run
from bt_jax.encoding.status import Status
from tests.helpers.ideal import STACK3, TASK, IdealCell


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    with Log(path) as log:
        IdealCell(log=log).executor.run()
    return path


def test_a_log_tells_every_moment(written):
    run = read_run(written)
    entries = [json.loads(line) for line in written.read_text().splitlines()]
    assert (run.program.task, run.program.tree) == (TASK, STACK3)
    assert len(run.moments) == sum(entry["kind"] == "tick" for entry in entries)
    assert run.solved
    assert run.reason == "the tree has succeeded"
    assert (run.seed, run.damaged) == (None, 0)
    times = [moment.time for moment in run.moments]
    assert times == sorted(times)
    assert times[0] == pytest.approx(0, abs=0.2)
    assert run.moments[-1].statuses[0] == Status.SUCCESS
    told = [event for moment in run.moments for event in moment.events]
    assert any(event.startswith("pick(YellowBox) ") for event in told)
    picking = next(moment for moment in run.moments if moment.action is not None)
    assert str(picking.action) == "pick(YellowBox)"


def test_moments_between_two_ticks_of_the_tree_keep_its_statuses(written):
    run = read_run(written)
    unticked = [i for i, moment in enumerate(run.moments) if moment.phase in ("committed", "settling")]
    assert unticked
    for i in unticked:
        assert run.moments[i].statuses == run.moments[i - 1].statuses


def test_where_the_arms_were_is_known_from_their_last_motion(written, tmp_path):
    lines = written.read_text().splitlines()
    motion = {
        "kind": "motion",
        "arm": "left",
        "time": [0.1],
        "setpoint": [[0.1] * 7],
        "measured": [[0.2] * 6 + [None]],
    }
    path = tmp_path / "moved.jsonl"
    path.write_text("\n".join([lines[0], json.dumps(motion), *lines[1:]]) + "\n")
    assert read_run(path).moments[-1].joints["left"].tolist() == [0.2] * 6 + [0.1]


def test_what_is_damaged_is_left_out_and_a_log_that_breaks_off_says_so(written, tmp_path):
    lines = written.read_text().splitlines()
    path = tmp_path / "damaged.jsonl"
    path.write_text("\n".join([*lines[:5], "{}", *lines[6:-1]]) + "\n")
    run = read_run(path)
    assert run.damaged == 1
    assert (run.reason, run.solved) == ("", False)
    path.write_text(lines[0] + "\n")
    with pytest.raises(UserError, match="tells no moment of a run; choose another log"):
        read_run(path)
