"""A learnt tree is tried in a process of its own."""

import asyncio
import json

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.processes.trial import Trial, try_out
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.lfd import DemonstrationFolder, Frames, learn
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task

TASK = load_task("stack")
ON_GREEN = Target("BlueBox", (0.0, 0.0, 0.1), "GreenBox")


@pytest.mark.slow
def test_a_tree_is_tried_and_kept(tmp_path):
    folder = DemonstrationFolder(tmp_path / "on green")
    folder.create(Frames.of(TASK))
    for one in demonstration_set(TASK, [ON_GREEN], count=3, rng=np.random.default_rng(0)):
        folder.append(one)
    trial = asyncio.run(try_out(folder.path, TASK, tmp_path / "runs", layouts=3))
    assert (trial.solved, trial.tried) == (3, 3)
    kept = tmp_path / "runs" / trial.folder
    assert parse_tree((kept / "learnt_tree.txt").read_text()) == learn(folder.read(), TASK).tree
    assert json.loads((kept / "lesson.json").read_text())["solved"] == 3


@pytest.mark.slow
def test_what_cannot_be_tried_is_said_in_a_sentence(tmp_path):
    with pytest.raises(UserError, match=r"^there is no folder .*nothing; give one with demonstrations"):
        asyncio.run(try_out(tmp_path / "nothing", TASK, tmp_path / "runs"))
    assert list(tmp_path.iterdir()) == []


def test_a_tree_that_does_only_the_last_step_says_so():
    assert Trial(20, 20, "").sentence == "It reaches what was demonstrated from 20 of 20 random starts."
    assert "let evolution find the rest, in step 5" in Trial(3, 20, "").sentence
