from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.history import History

STEPS = st.lists(st.one_of(st.integers(0, 9), st.sampled_from(["undo", "redo"])), max_size=60)


@given(STEPS)
def test_it_is_a_line_of_versions_with_a_place_in_it(steps):
    history, line, at = History(-1), [-1], 0
    for step in steps:
        try:
            match step:
                case "undo":
                    history = history.undone()
                    at -= 1
                case "redo":
                    history = history.redone()
                    at += 1
                case _:
                    history = history.changed(step)
                    line, at = [*line[: at + 1], step], at + 1
        except UserError:
            assert at == (0 if step == "undo" else len(line) - 1)
        assert history.present == line[at]
        assert (len(history.past), len(history.future)) == (at, len(line) - 1 - at)
