"""What using the library leaves of the process that uses it."""

import os

import jax
from jax._src import monitoring  # the listeners have no public list

import bt_jax


def settings() -> tuple:
    listeners = (monitoring.get_event_listeners(), monitoring.get_event_duration_listeners())
    return dict(jax.config.values), *map(list, listeners), dict(os.environ)


def test_evolving_changes_no_setting_of_the_caller(tmp_path):
    before = settings()
    config = bt_jax.GPConfig(population=8, generations=2, max_nodes=16)
    result = bt_jax.evolve(bt_jax.load_task("stack"), config, bt_jax.Settings(level="kinematic", test_layouts=3))
    result.save(tmp_path / "run")
    assert settings() == before
    assert bt_jax.read_tree(tmp_path / "run" / "best_tree.txt") == result.tree
    assert 0 <= result.success_rate <= 1
