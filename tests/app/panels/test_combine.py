"""What evolution will work for, before one says so."""

import numpy as np
import pytest

from bt_jax.app.panels.combine import ANYWHERE, _places, _preview
from bt_jax.app.plain_words import Words
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task
from bt_jax.training.phases import Changes
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

STACK, RESTACK = load_task("stack"), load_task("restack")
ON_GREEN = Target("BlueBox", (0.0, 0.0, 0.1), "GreenBox")


@pytest.fixture
def shown(tmp_path):
    folder = DemonstrationFolder(tmp_path / "on_green")
    folder.create(Frames.of(STACK))
    for one in demonstration_set(STACK, [ON_GREEN], count=3, rng=np.random.default_rng(0)):
        folder.append(one)
    return folder.path


def test_targets_are_those_of_the_run_and_not_of_the_page(tmp_path, shown):
    run = RunFolder.create(tmp_path / "run", RunConfig(STACK, GPConfig(), Settings()))
    preview = _preview(RESTACK, run, Changes(target_from=shown))
    assert preview.problem is None
    assert preview.before == STACK
    assert preview.after.targets == (*STACK.targets, ON_GREEN)
    assert _preview(RESTACK, run, Changes()).after == STACK


def test_where_the_learnt_tree_belongs_is_asked_only_if_evolution_does_not_find_out(tmp_path):
    for method, anywhere in (("achievements", True), ("population", False)):
        run = RunFolder.create(tmp_path / method, RunConfig(STACK, GPConfig(method=method), Settings()))
        assert _preview(STACK, run, Changes()).anywhere == anywhere


def test_without_a_run_it_is_the_task_of_the_page(shown):
    preview = _preview(STACK, None, Changes(subgoal_from=shown))
    assert preview.after.targets == STACK.targets
    (subgoal,) = preview.after.subgoals
    assert subgoal.name == "on_green"
    assert "at(BlueBox, (0, 0, 0.1), GreenBox)" in subgoal.conditions


def test_what_cannot_be_is_said(tmp_path):
    preview = _preview(STACK, None, Changes(target_from=tmp_path / "nothing"))
    assert preview.before == preview.after == STACK
    assert "there is no folder" in str(preview.problem)


def test_places_are_the_children_of_the_root():
    words = Words(STACK)
    tree = parse_tree("Sequence(pick(GreenBox), close_gripper)")
    places = _places(tree, words)
    assert list(places) == [ANYWHERE, 0, 1, 2]
    assert places[1] == "as step 2, before “Close the gripper”"
    assert places[2] == "as step 3, at the end"
    assert list(_places(parse_tree("close_gripper"), words)) == list(_places(None, words)) == [ANYWHERE, 0]
