"""What a person says about a run is read back as it was said, and a damaged file says nothing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.training.run_note import RunNote, read_note, write_note

LINES = st.text(st.characters(exclude_categories=["C", "Z"]), max_size=30)


@given(name=st.lists(LINES, max_size=3).map(" ".join), note=st.lists(LINES, max_size=4).map("\n".join))
def test_what_is_said_is_read_back(tmp_path_factory, name, note):
    folder = tmp_path_factory.mktemp("run")
    write_note(folder, RunNote(name[:80], note))
    assert read_note(folder) == RunNote(" ".join(name[:80].split()), note.strip())
    assert [path.name for path in folder.iterdir()] == ["note.json"]


@pytest.mark.parametrize("content", [b"", b"[" * 6000, b"\xff", b"{}", b'{"name": 3}', b'{"title": "x"}'])
def test_a_damaged_note_says_nothing_and_can_be_replaced(tmp_path, content):
    assert read_note(tmp_path) == RunNote()
    (tmp_path / "note.json").write_bytes(content)
    assert read_note(tmp_path) == RunNote()
    write_note(tmp_path, RunNote("again"))
    assert read_note(tmp_path) == RunNote("again")


def test_a_note_that_is_too_long_or_of_no_run_is_a_sentence(tmp_path):
    for note, says in ((RunNote("x" * 81), "the name has 81"), (RunNote(note="x" * 4001), "the note has 4,001")):
        with pytest.raises(UserError, match=f"{says} characters; shorten it"):
            write_note(tmp_path, note)
    with pytest.raises(UserError, match="the run gone is no longer there"):
        write_note(tmp_path / "gone", RunNote("x"))
    assert list(tmp_path.iterdir()) == []
