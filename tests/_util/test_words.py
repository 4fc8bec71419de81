import pytest

from bt_jax._util.words import counted


@pytest.mark.parametrize(
    ("number", "noun", "said"),
    [
        (0, "box", "0 boxes"),
        (1, "box", "1 box"),
        (2, "box", "2 boxes"),
        (1, "demonstration", "1 demonstration"),
        (1200, "demonstration", "1,200 demonstrations"),
    ],
)
def test_a_noun_follows_its_number(number, noun, said):
    assert counted(number, noun) == said
