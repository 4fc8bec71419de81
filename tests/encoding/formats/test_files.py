"""A tree is read from whatever train and learn have written."""

import json

import pytest

from bt_jax._util.errors import UserError
from bt_jax.encoding.formats.files import check_tree, read_tree
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.tasks import load_task

TREE = "pick(YellowBox)"
JSON = {
    "lesson.json": {"tree": TREE, "goals": []},
    "progress.json": {"pid": 3, "tree": TREE},
    "result.json": {"runs": [{"fitness": -9, "tree": "pick(BlueBox)"}, {"fitness": -2.5, "tree": TREE}, {"tree": "x"}]},
}


@pytest.mark.parametrize("name", JSON)
def test_json_of_train_and_learn_says_a_tree(tmp_path, name):
    (tmp_path / name).write_text(json.dumps(JSON[name]))
    assert read_tree(tmp_path / name) == parse_tree(TREE)


@pytest.mark.parametrize("data", [{}, [], 3, {"tree": 3}, {"runs": []}, {"runs": [{}]}, {"runs": {"fitness": 1}}])
def test_json_without_a_tree_is_a_sentence(tmp_path, data):
    (tmp_path / "other.json").write_text(json.dumps(data))
    with pytest.raises(UserError, match=r"other\.json says no tree; give a \.json file of train or learn"):
        read_tree(tmp_path / "other.json")


def test_a_tree_of_other_objects_is_named_with_its_source():
    with pytest.raises(UserError, match=r"mine: .*PinkBox"):
        check_tree(parse_tree("Sequence(pick(YellowBox), pick(PinkBox))"), load_task("stack"), "mine")
