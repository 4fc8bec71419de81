import dataclasses

import pytest

from bt_jax.deploy.__main__ import main
from bt_jax.deploy.commands import twin
from bt_jax.deploy.commands.twin import overall_exit_code
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.twin.settings import Realism


@pytest.mark.parametrize(
    ("codes", "overall"),
    [
        ([Exit.DONE, Exit.DONE], Exit.DONE),
        ([Exit.DONE, Exit.FAILED], Exit.FAILED),
        ([Exit.FAILED, Exit.STOPPED, Exit.DONE], Exit.STOPPED),
    ],
)
def test_a_protective_stop_in_any_layout_is_told(codes, overall):
    assert overall_exit_code(codes) == overall


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], Realism()),
        (["--realism.blur", "1"], dataclasses.replace(Realism(), blur=1.0)),
        (["--perfect"], Realism.perfect()),
        (["--perfect", "--realism.blur", "0.7"], dataclasses.replace(Realism.perfect(), blur=0.7)),
        (["--worse", "1.5"], Realism().scaled(1.5)),
        (["--worse", "1.5", "--realism.egm-lag", "0.05"], dataclasses.replace(Realism().scaled(1.5), egm_lag=0.05)),
    ],
)
def test_single_values_count_before_a_preset(monkeypatch, words, expected):
    """Also where the value that was given is the default of the other preset."""
    seen = []
    monkeypatch.setattr(twin, "twin_command", lambda arguments: seen.append(arguments) or 0)
    assert main(["twin", "tree.txt", *words]) == 0
    assert seen[0].realism == expected
    assert str(seen[0].source) == "tree.txt"


@pytest.mark.parametrize("words", [["--perfect", "--worse", "2"], ["--worse", "0"], ["--worse", "nan"]])
def test_presets_that_exclude_each_other_are_refused(capsys, words):
    assert main(["twin", "tree.txt", *words]) == Exit.USER_ERROR
    assert "--worse" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--faults", "wind"], "there are no faults 'wind'; choose one of mild, harsh"),
        (["--faults", "faults.yaml"], "there is no object 'RedBox'; use some of YellowBox"),
        (["--faults", "mild", "--realtime"], "need simulated time; leave out --realtime"),
        (["--faults", "mild", "--disturb"], "leave out --disturb"),
        (["--draw", "2"], "nothing does in this task; add --faults"),
        (["--draw", "0"], "--draw start at 1"),
    ],
)
def test_faults_that_cannot_be_provoked_are_one_sentence(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.txt").write_text("pick(YellowBox)")
    (tmp_path / "faults.yaml").write_text("{slip: 0.1, objects: [RedBox]}")
    assert main(["twin", "tree.txt", *words]) == Exit.USER_ERROR
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "runs").exists(), "nothing was begun"
