import pytest

from bt_jax._util.errors import LONGEST, UserError


def test_a_sentence_is_one_line_without_endless_words():
    path = "/".join(["folder"] * 20)
    error = UserError(f"{path}: '{'x' * 5000}' is\nno name; choose another")
    assert str(error) == f"{path}: '{'x' * 99}...{'x' * 19}' is no name; choose another"


@pytest.mark.parametrize(
    ("quoted", "shown"),
    [("\x1b[31m", r"\x1b[31m"), ("\x00", r"\x00"), ("\u00a0", r"\xa0"), ("箱子 ä", "箱子 ä"), ("\ud800", r"\ud800")],
)
def test_control_characters_that_an_error_quotes_are_named(quoted, shown):
    assert str(UserError(f"'{quoted}' is no box; choose one")) == f"'{shown}' is no box; choose one"


def test_a_long_error_keeps_its_beginning_and_its_remedy():
    text = str(UserError(f"task.yaml: unknown boxes {'Box, ' * 10_000}; choose YellowBox"))
    assert len(text) == LONGEST
    assert text.startswith("task.yaml: unknown boxes Box, ")
    assert text.endswith("; choose YellowBox")
