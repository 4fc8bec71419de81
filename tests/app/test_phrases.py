"""What the page says of errors: nothing of command lines, and no path outside its folder."""

import ast
import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import bt_jax
from bt_jax._util.errors import UserError
from bt_jax.app.phrases import PHRASES, phrase

COMMAND = re.compile(r"--[a-z]|python -m |bt-jax ")
ELSEWHERE = (
    "bt_jax.commands",
    "bt_jax.deploy",
    "bt_jax.experiments",
    "bt_jax.app.__main__",
)  # command lines of their own
ROOT = Path(bt_jax.__file__).parent


def test_a_remedy_on_the_command_line_is_left_out():
    folder = Path("/home/anna/my work")
    for said, expected in (
        ("the disk is full; free some space, or choose another --out", "the disk is full"),
        ("the gripper is empty; pick an object first", "the gripper is empty; pick an object first"),
        (
            "/home/anna/my work/tasks/a b.yaml, line 3, is not valid YAML; fix that line",
            "tasks/a b.yaml, line 3, is not valid YAML; fix that line",
        ),
        ("/home/anna/my work cannot be written; free some space", "the page's folder cannot be written; free some space"),
        ("'/tmp/bt_jax-x1/stack.yaml' has gone (see /var/log/page)", "'stack.yaml' has gone (see page)"),
        ("/home/anna/my work/.inputs/tmpk3/stack.yaml: no target; give one", "stack.yaml: no target; give one"),
        ("/home/anna/my workshop/a.yaml has gone", "my workshop/a.yaml has gone"),
        ("1/2 of the trees are at 0.5 m/s; wait", "1/2 of the trees are at 0.5 m/s; wait"),
    ):  # fmt: skip
        assert phrase(said, folder) == expected


def test_paths_in_a_relative_folder_begin_there():
    assert phrase("my_work/tasks/a.yaml has gone; restore it", Path("my_work")) == "tasks/a.yaml has gone; restore it"
    assert phrase("tasks/a.yaml has gone; restore it", Path()) == "tasks/a.yaml has gone; restore it"


def test_the_page_has_remedies_of_its_own():
    error = UserError("the tree has 70 nodes and 64 fit; raise --max-nodes", code="too many nodes", nodes=70, room=64)
    assert phrase(error, Path()) == "the tree has 70 nodes and 64 fit; demonstrate less at once"
    assert str(error).endswith("--max-nodes")


def raised():
    """All errors that can reach the page: where they are raised, what they say with x for all that varies, their code, and
    the names of their parameters."""
    for module in pkgutil.walk_packages([str(ROOT)], "bt_jax."):
        if module.name.startswith(ELSEWHERE):
            continue
        path = Path(importlib.util.find_spec(module.name).origin)
        tree = ast.parse(path.read_text(encoding="utf-8"))
        constants = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for call in ast.walk(tree):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "UserError" and call.args:
                keywords = {word.arg: word.value for word in call.keywords}
                code = keywords.pop("code", ast.Constant("")).value
                yield f"{module.name}:{call.lineno}", text(call.args[0], constants), code, keywords.keys()


def text(node, constants):
    """The text of an expression, with x for what is not known before the program runs."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text(part, constants) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return text(node.value, constants) if isinstance(node.value, ast.Name) else "x"
    if isinstance(node, ast.BinOp):
        return text(node.left, constants) + text(node.right, constants)
    if isinstance(node, ast.IfExp):
        return text(node.body, constants) + text(node.orelse, constants)
    if isinstance(node, ast.Name) and node.id in constants:
        return text(constants[node.id], {})
    return "x"


def test_no_error_tells_the_page_of_a_command_line():
    found, codes = list(raised()), {}
    assert len(found) > 150
    for where, said, code, names in found:
        codes[code] = names
        shown = phrase(UserError(said, code=code, **dict.fromkeys(names, "x")), Path("/work"))
        assert not COMMAND.search(shown), where
        assert shown != "this cannot be done on the page", (
            f"{where}: name options in the remedy only, after a semicolon"
        )
    assert codes.keys() - {""} == PHRASES.keys()


@pytest.mark.parametrize("code", PHRASES)
def test_phrases_end_with_a_remedy(code):
    assert "; " in PHRASES[code]
    assert not COMMAND.search(PHRASES[code])
