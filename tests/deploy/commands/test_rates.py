import io
import json

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax._util.statistics import wilson
from bt_jax.deploy.__main__ import main
from bt_jax.deploy.commands.arguments import RatesArguments
from bt_jax.deploy.commands.rates import as_yaml, estimates, rates_command
from bt_jax.deploy.execution.fault_counts import FaultCounts
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.settings import Exit
from bt_jax.tasks import load_faults, load_task, with_faults
from tests.helpers.ideal import IdealCell


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The log of a run in which nothing went wrong."""
    path = tmp_path_factory.mktemp("logs") / "log.jsonl"
    with Log(path) as log:
        assert IdealCell(log=log).executor.run().exit_code == Exit.DONE
    return path


def printed(*logs, out=None):
    console = Console(file=io.StringIO(), width=200)
    assert rates_command(RatesArguments(logs, out), console) == 0
    return console.file.getvalue()


def test_the_rates_of_a_log_are_faults_that_a_task_takes(log, tmp_path):
    shown = printed(log, log.parent, out=tmp_path / "faults.yaml")
    assert "0 of 3 picks" in shown
    assert "0 to 0.561" in shown, "what never happened in three tries may be likely"
    assert "1; a tick stands for" in shown, "a log that is named twice counts once"
    faults = load_faults(tmp_path / "faults.yaml")
    assert (faults.slip, faults.drop, faults.jam, faults.hide) == (0, 0, 0, 0)
    assert with_faults(load_task("stack3"), faults).faults == faults


COUNTS = st.integers(1, 40).flatmap(
    lambda tries: st.builds(
        FaultCounts,
        attempts=st.just(2 * tries),
        picks=st.just(tries),
        places=st.just(tries),
        slips=st.integers(0, tries),
        drops=st.integers(0, tries),
        jams=st.integers(0, tries),
        errors=st.lists(st.tuples(*[st.floats(-0.02, 0.02)] * 2), max_size=5).map(tuple),
        turns=st.lists(st.floats(-20, 20), max_size=5).map(tuple),
        moved=st.integers(0, 3),
        hidden=st.lists(st.floats(0, 30), max_size=3).map(tuple),
        taken=st.lists(st.floats(0, 30), max_size=3).map(tuple),
        attempting=st.floats(1, 1000),
        running=st.floats(1, 2000),
    )
)


@settings(deadline=None)
@given(COUNTS)
@example(FaultCounts(attempts=58, picks=29, places=29, drops=28, jams=2, attempting=1.0, running=1.0))
def test_whatever_was_counted_gives_faults_that_are_read(tmp_path_factory, counts):
    path = tmp_path_factory.mktemp("faults") / "faults.yaml"
    path.write_text(as_yaml(estimates(counts), counts, 1))
    faults = load_faults(path)
    found = {estimate.key: estimate for estimate in estimates(counts)}
    if faults.move + faults.take <= 1:
        with_faults(load_task("stack3"), faults)
    for key, estimate in found.items():
        assert getattr(faults, key) == pytest.approx(estimate.value, rel=0.01)
    for key, tries in (("slip", counts.picks), ("drop", counts.places)):
        count = getattr(counts, f"{key}s")
        assert (found[key].low, found[key].high) == wilson(count, tries)


def test_intervals_of_spreads_cover_the_true_one():
    rng, spread, covered = np.random.default_rng(0), 0.004, 0
    for _ in range(400):
        errors = tuple(map(tuple, rng.normal(0, spread, (6, 2)).tolist()))
        found = next(
            e for e in estimates(FaultCounts(attempts=1, attempting=1.0, errors=errors)) if e.key == "place_spread"
        )
        covered += found.low <= spread <= found.high
    assert 0.92 < covered / 400 < 0.98


def test_what_cannot_be_counted_is_one_sentence(log, tmp_path, capsys):
    with pytest.raises(UserError, match=r"has no log \(.jsonl\)"):
        printed(tmp_path)
    lines = log.read_text().splitlines()
    (tmp_path / "start.jsonl").write_text(lines[0] + "\n")
    with pytest.raises(UserError, match="no attempt was carried out"):
        printed(tmp_path / "start.jsonl")
    old = [json.dumps({k: v for k, v in json.loads(line).items() if k != "fault"}) for line in lines]
    (tmp_path / "old.jsonl").write_text("\n".join(old) + "\n")
    assert main(["rates", str(tmp_path / "old.jsonl")]) == Exit.USER_ERROR
    assert "old.jsonl: it does not say which fault ended an attempt" in capsys.readouterr().err
    assert main(["rates", str(log), "--out", "rates.csv"]) == Exit.USER_ERROR
    assert "rates.csv is no file of faults" in capsys.readouterr().err
