"""A report says what a run's tree does and how often it works, whatever else is missing, and is harmless whatever it is
told."""

import dataclasses
from datetime import datetime

import pytest

from bt_jax.app.report import report
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import Generation
from bt_jax.report import main
from bt_jax.tasks import load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.run_note import RunNote, write_note
from bt_jax.training.settings import Settings

TODAY = datetime(2026, 3, 4, 5, 6)
TREE = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))")
FAILURES = [
    {"reason": "GreenBox <fell>", "layouts": list(range(1, 15)), "draws": []},
    {"reason": "YellowBox is put somewhere else", "layouts": [40, 41], "draws": []},
]
RESULT = {
    "test_layouts": 100,
    "success_rate": 0.83,
    "failures": FAILURES,
    "faults": {"slip": {"solved": 3, "episodes": 9}},
}


@pytest.fixture
def run(tmp_path):
    return RunFolder.create(tmp_path / "run", RunConfig(load_task("stack"), GPConfig(), Settings()))


def finished(run):
    run.save_tree(TREE, title="x")
    run.save_history(history())
    run.save_result(RESULT)
    write_note(run.path, RunNote("for <Monday>", "first line\nsecond line"))


def history():
    fields = {field.name: 0.0 if field.type == "float" else 0 for field in dataclasses.fields(Generation)}
    return [Generation(**{**fields, "generation": i, "best": -500.0 / (i + 1), "mean": -900.0}) for i in range(4)]


def test_a_finished_run_is_reported_with_everything(run):
    finished(run)
    said = report(run, today=TODAY)
    for part in (
        "<title>for &lt;Monday&gt;</title>",
        "first line\nsecond line",
        "04 March 2026, 05:06",
        "<b>83 %</b>",
        "works in 83 of 100 starts that it never saw (95 %: 74 to 89\N{NO-BREAK SPACE}%)",
        "<li>Put YellowBox in the middle of the kit</li>",
        "Put GreenBox on",
        '<td class="number">14</td><td>GreenBox &lt;fell&gt;</td><td>1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, and 2 more</td>',
        '<td class="number">1</td><td>for other reasons</td>',
        '<td>slips</td><td class="number">3 of 9</td>',
        "@media print",
        "generation",
    ):
        assert part in said, part
    assert said.count("<svg") == said.count("</svg>") == 2
    assert "<script" not in said
    assert 'src="http' not in said
    assert "url(http" not in said


def test_a_run_that_has_just_begun_is_reported_too(run):
    said = report(run, today=TODAY)
    for part in ("There is no tree yet.", "It was not tested yet", "There is no learning curve yet."):
        assert part in said


@pytest.mark.parametrize("failures", [None, 3, [], [{"reason": 3}], [{"reason": "x", "layouts": ["a"], "draws": []}]])
def test_older_and_damaged_results_are_reported_without_reasons(run, failures):
    run.save_tree(TREE, title="x")
    run.save_result({**RESULT, "failures": failures, "faults": {"slip": 3, "<b>": {}}})
    said = report(run, today=TODAY)
    assert '<td class="number">17</td><td>for other reasons</td>' in said
    assert "slips" not in said


def test_nothing_that_a_run_says_is_code(run):
    evil = "<script>alert(1)</script>"
    finished(run)
    write_note(run.path, RunNote(evil[:80], evil))
    run.save_result({**RESULT, "failures": [{"reason": evil, "layouts": [1], "draws": []}]})
    assert "<script" not in report(run, today=TODAY)


def test_the_command_writes_what_the_page_shows(run, tmp_path, capsys):
    finished(run)
    with pytest.raises(SystemExit) as end:
        main([str(run.path), "--out", str(tmp_path / "out.html")])
    assert end.value.code in (0, None)
    assert f"written    {tmp_path / 'out.html'}" in capsys.readouterr().out
    assert "for &lt;Monday&gt;" in (tmp_path / "out.html").read_text(encoding="utf-8")
    with pytest.raises(SystemExit) as end:
        main([str(tmp_path / "nothing")])
    assert end.value.code == 2
    assert "is not a run folder" in capsys.readouterr().err
