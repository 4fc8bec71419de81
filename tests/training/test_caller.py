"""The library in somebody's program: what it shows, and what it leaves of the process."""

import os

import jax
from jax._src import monitoring  # the listeners have no public list

import bt_jax

MUJOCO_SETS = "PYOPENGL_PLATFORM"  # when a process renders for the first time


def settings() -> tuple:
    listeners = (monitoring.get_event_listeners(), monitoring.get_event_duration_listeners())
    environment = {name: value for name, value in os.environ.items() if name != MUJOCO_SETS}
    return dict(jax.config.values), *map(list, listeners), environment


def evolve(**options) -> bt_jax.Result:
    config = bt_jax.GPConfig(population=8, generations=2, max_nodes=32)
    settings = bt_jax.Settings(level="kinematic", test_layouts=10)
    return bt_jax.evolve(bt_jax.load_task("stack"), config, settings, **options)


def test_evolving_changes_no_setting_of_the_caller(tmp_path):
    before = settings()
    result = evolve()
    result.save(tmp_path / "run")
    assert settings() == before
    assert bt_jax.read_tree(tmp_path / "run" / "best_tree.txt") == result.tree
    assert 0 <= result.success_rate <= 1


def test_progress_is_shown_if_asked_for_or_at_a_prompt(capsys, monkeypatch):
    evolve()
    assert capsys.readouterr().out == ""
    evolve(progress=True)
    assert [line[:16] for line in capsys.readouterr().out.splitlines()] == [f"generation    {i} " for i in range(3)]
    monkeypatch.setattr("sys.ps1", ">>> ", raising=False)
    evolve()
    assert len(capsys.readouterr().out.splitlines()) == 3
    evolve(progress=False)
    assert capsys.readouterr().out == ""


def test_a_result_prints_well():
    result = evolve()
    summary = f"stack: fitness {result.fitness:.1f}, solves {result.success_rate:.0%} of 10 unseen layouts"
    assert repr(result) == f"<Result of {summary}>"
    assert str(result) == f"{summary}\n{bt_jax.draw_text(result.tree).rstrip()}"
    assert result._repr_html_() == f"<p>{summary}</p>{bt_jax.to_svg(result.tree)}"
