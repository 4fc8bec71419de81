"""Text files from any editor: byte order marks, line ends, other encodings."""

import codecs
import os
from pathlib import Path

import pytest

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import read_text

TEXT = "Sequence\n  pick(Schlüssel)\n"


@pytest.mark.parametrize(
    ("mark", "encoding"),
    [
        (b"", "utf-8"),
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
        (codecs.BOM_UTF32_LE, "utf-32-le"),
        (codecs.BOM_UTF32_BE, "utf-32-be"),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_marks_and_line_ends_are_not_part_of_the_text(tmp_path, mark, encoding, end):
    path = tmp_path / "tree.txt"
    path.write_bytes(mark + TEXT.replace("\n", end).encode(encoding))
    assert read_text(path) == TEXT


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (TEXT.encode("cp1252"), "tree.txt, line 2: not UTF-8 text; save the file as UTF-8"),
        ("pick(YellowBox)".encode("utf-16-le"), "tree.txt, line 1: holds a NUL character"),  # without a mark
        (codecs.BOM_UTF16_LE + TEXT.encode("utf-16-le")[:-1], "tree.txt, line 2: not UTF-16-LE text"),
        (b"pick(Yellow\0Box)", "tree.txt, line 1: holds a NUL character"),
    ],
)
def test_other_bytes_are_refused_with_file_and_line(tmp_path, data, message):
    path = tmp_path / "tree.txt"
    path.write_bytes(data)
    with pytest.raises(UserError) as raised:
        read_text(path)
    assert message in str(raised.value)


def test_what_is_no_file_is_named(tmp_path):
    with pytest.raises(UserError, match=r"there is no file .*missing.txt"):
        read_text(tmp_path / "missing.txt")
    with pytest.raises(UserError, match="is a folder"):
        read_text(tmp_path)
    with pytest.raises(UserError, match="cannot be a path"):
        read_text(tmp_path / "a\0b")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_what_may_never_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "tree.txt")
    for path in (tmp_path / "tree.txt", Path("/dev/zero")):
        with pytest.raises(UserError, match=f"^{path} is a pipe or a device; give a file$"):
            read_text(path)
