from bt_jax._util.errors import UserError


def test_a_sentence_is_one_line_without_endless_words():
    path = "/".join(["folder"] * 20)
    error = UserError(f"{path}: '{'x' * 5000}' is\nno name; choose another")
    assert str(error) == f"{path}: '{'x' * 99}...{'x' * 19}' is no name; choose another"
