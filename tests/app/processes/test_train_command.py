"""What the page wants reaches the command line of training unchanged."""

import os
import time
from pathlib import Path

import pytest

from bt_jax.app.processes.train_command import Beginning, TrainCommand
from bt_jax.commands.arguments import parse_train as parse
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig, Selection
from bt_jax.tasks import load_task, task_names
from bt_jax.training.phases import Changes
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

TREE = parse_tree("Sequence(pick(YellowBox), place(YellowBox, (0, 0, 0.052), KittingBox))")


@pytest.mark.parametrize("name", task_names())
def test_task_settings_and_folder(tmp_path, name):
    command, task = TrainCommand(tmp_path), load_task(name)
    gp = GPConfig(
        population=24, generations=7, seed=3, max_nodes=32, baseline_keep=False, niches=True, p_add=0.2, p_change=0.3,
        parent_selection=Selection.RANK, elites=3,
    )  # fmt: skip
    found = parse(command.start(task, gp, tmp_path / "run"))
    assert (found.gp, load_task(found.task), found.out) == (gp, task, tmp_path / "run")
    assert parse(command.start(task, GPConfig())).gp == GPConfig()


def test_where_it_begins(tmp_path):
    begin = Beginning(TREE, without=(parse_tree("move(GreenBox, (0, 0, 0.1), YellowBox)"), parse_tree("open_gripper")))
    found = parse(TrainCommand(tmp_path).start(load_task("stack"), GPConfig(), tmp_path / "run", begin))
    assert read_tree(found.baseline) == TREE
    assert found.without == ("move(GreenBox, (0, 0, 0.1), YellowBox)", "open_gripper")


def test_going_on_with_what_was_taught(tmp_path):
    folder = RunFolder.create(tmp_path / "run", RunConfig(load_task("stack"), GPConfig(seed=3), Settings()))
    command = TrainCommand(tmp_path / "inputs")
    plain = parse(command.go_on(folder.path, 70))
    assert (plain.resume, plain.gp) == (folder.path, GPConfig(seed=3, generations=70))
    changes = Changes(
        TREE, target_from=tmp_path / "top", subgoal_from=Path("way"), baseline_index=0, task=load_task("pyramid")
    )
    taught = parse(command.go_on(folder.path, 70, changes))
    assert read_tree(taught.baseline) == TREE
    assert load_task(taught.task) == load_task("pyramid")
    assert (taught.add_target_from, taught.add_subgoal_from) == (tmp_path / "top", Path("way").resolve())
    assert taught.gp.baseline_index == 0


def test_anywhere_means_anywhere_after_an_earlier_place(tmp_path):
    placed = RunConfig(load_task("stack"), GPConfig(baseline_index=1), Settings(), baseline=TREE)
    folder = RunFolder.create(tmp_path / "run", placed)
    words = TrainCommand(tmp_path / "inputs").go_on(folder.path, 70, Changes(TREE, baseline_index=None))
    assert parse(words).gp.baseline_index is None


def test_a_training_can_read_its_files_after_the_page_was_closed(tmp_path):
    command = TrainCommand(tmp_path)
    words = command.start(load_task("stack"), GPConfig())
    del command
    TrainCommand(tmp_path)
    assert load_task(parse(words).task) == load_task("stack")


def test_files_of_earlier_days_are_deleted(tmp_path):
    old, new = (parse(TrainCommand(tmp_path).start(load_task("stack"), GPConfig())).task for _ in range(2))
    os.utime(old.parent, (time.time() - 2 * 24 * 3600,) * 2)
    TrainCommand(tmp_path)
    assert (old.exists(), new.exists()) == (False, True)
