"""The experiment on faults: what it keeps, what it concludes, and that it goes on where it was stopped."""

import dataclasses
import json

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.experiments.robust.arguments import RobustArguments
from bt_jax.experiments.robust.command import run
from bt_jax.experiments.robust.models import CONDITIONS, MODELS, known
from bt_jax.experiments.robust.records import Records
from bt_jax.experiments.robust.report import Outcomes, comparison, figure, markdown, rates
from bt_jax.tasks import load_faults

TREES = ("Sequence(pick(A), open_gripper)", "retry(3, Sequence(pick(A), open_gripper))", "open_gripper")


def outcomes(model, shares):
    """Trees that solve shares of 100 episodes, always the first."""
    solved = np.arange(100)[None] < 100 * np.array(shares)[:, None]
    return Outcomes("stack", model, TREES[: len(shares)], dict.fromkeys(CONDITIONS, solved))


RESULTS = [
    outcomes("evolved_without", [0.2, 0.5, 0.4]),
    outcomes("evolved_with", [0.9, 0.7, 0.4]),
    outcomes("planned_with", [0.8]),
]


def test_the_tree_in_the_middle_stands_for_the_others():
    rows = rates(RESULTS)
    assert [row["all"] for row in rows] == [
        "40.0 (30.9-49.8; 20.0-50.0)",
        "70.0 (60.4-78.1; 40.0-90.0)",
        "80.0 (71.1-86.7)",
    ]
    assert [row["all, mean of runs"] for row in rows] == ["36.7 ± 15.3", "66.7 ± 25.2", "80.0"]


def test_the_same_episodes_are_compared():
    rows = comparison(RESULTS)
    assert [(row["only with faults"], row["only without"], row["p"]) for row in rows] == [
        ("70", "0", "1.7e-21"),
        ("20", "0", "1.9e-06"),
        ("0", "0", "1.0e+00"),
    ]


def test_report_and_figure():
    assert figure(RESULTS).startswith(b"\x89PNG")
    text = markdown(RESULTS, settings={"draws": "5"}, machine="2 cores.")
    assert "Settings: draws 5. 2 cores." in text
    assert "stack, planned with faults:" in text


def test_what_was_found_comes_back(tmp_path):
    source, solved = tmp_path / "results.json", np.random.default_rng(0).random(37) < 0.5
    records = Records.begun(source, {"seed": "0"})
    records.note("a", solved)
    records.save(source)
    again = Records.begun(source, {"seed": "0"})
    np.testing.assert_array_equal(again.solved("a", 37), solved)
    with pytest.raises(UserError, match="was begun with seed 0 and now it is 1; choose another --out"):
        Records.begun(source, {"seed": "1"})


def test_held_out_faults_are_unknown_to_evolution():
    faults = known(load_faults("harsh"), ("take", "heavy"))
    assert (faults.take, faults.heavy) == (0, 0)
    assert faults == dataclasses.replace(load_faults("harsh"), take=0.0, heavy=0.0)
    with pytest.raises(UserError, match="there is no fault 'rain'"):
        RobustArguments(held_out=("rain",)).check()


@pytest.mark.slow
def test_the_experiment_goes_on_where_it_was_stopped(tmp_path, capsys):
    arguments = RobustArguments(("stack",), seeds=1, layouts=2, draws=2, out=tmp_path)
    run(arguments)
    found = json.loads((tmp_path / "results.json").read_text())
    assert set(found["trees"]) == {f"stack/{model}/0" for model in MODELS}
    assert (tmp_path / "robust.png").exists()
    del found["tests"][next(iter(found["tests"]))]
    (tmp_path / "results.json").write_text(json.dumps(found))
    capsys.readouterr()
    run(arguments)
    assert len(capsys.readouterr().out.splitlines()) == 2  # the test that was missing, and the report
