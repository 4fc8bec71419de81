"""What the page says is said in words of the shop floor, also where it is said seldom."""

import ast
from pathlib import Path

import bt_jax.app
from tests.helpers.browser.words import BANNED

APP = Path(bt_jax.app.__file__).parent
SPOKEN = ("panels", "widgets", "state", "processes", "plain_words.py", "phrases.py")


def sentences(tree):
    """The strings of a module that may be sentences, without those that explain the code."""
    explaining = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str) or id(node) in explaining:
            continue
        is_pattern = "\\" in node.value
        if " " in node.value.strip() and "data-testid" not in node.value and not is_pattern:
            yield node.value


def test_no_sentence_needs_a_laboratory():
    found = []
    for spoken in SPOKEN:
        for path in [APP / spoken] if spoken.endswith(".py") else sorted((APP / spoken).rglob("*.py")):
            for sentence in sentences(ast.parse(path.read_text(encoding="utf-8"))):
                if BANNED.search(sentence):
                    found.append(f"{path.relative_to(APP)}: {sentence}")
    assert found == []
