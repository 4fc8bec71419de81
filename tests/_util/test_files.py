import os
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic


@settings(max_examples=20)
@given(st.binary(max_size=2000) | st.text(st.characters(codec="utf-8"), max_size=200))
def test_what_is_written_is_read(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("out") / "deeper" / "file"
    write_atomic(path, "old")
    write_atomic(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert os.listdir(path.parent) == ["file"]


def test_a_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot be written.*choose another folder"):
        write_atomic(tmp_path / "file" / "inner", "text")


def test_a_folder_in_place_of_the_file(tmp_path):
    (tmp_path / "target").mkdir()
    with pytest.raises(UserError, match="cannot be written"):
        write_atomic(tmp_path / "target", "text")
    assert os.listdir(tmp_path) == ["target"]


def test_a_failure_half_way_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_atomic(path, "old")

    def fail(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(UserError, match="No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600)])
def test_others_may_read_what_the_umask_lets_them(tmp_path, mask, mode):
    code = f"import os, sys; os.umask({mask}); from pathlib import Path; from bt_jax._util.files import write_atomic; "
    subprocess.run([sys.executable, "-c", f"{code}write_atomic(Path(sys.argv[1]), 'x')", tmp_path / "f"], check=True)
    assert (tmp_path / "f").stat().st_mode & 0o777 == mode


def test_a_full_disk(tmp_path):
    mount = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", tmp_path], capture_output=True)
    if mount.returncode:
        pytest.skip("mounting a small disk takes more rights than this process has")
    try:
        write_atomic(tmp_path / "file", b"old")
        with pytest.raises(UserError, match="free some space"):
            write_atomic(tmp_path / "file", bytes(1 << 20))
        assert (tmp_path / "file").read_bytes() == b"old"
        assert os.listdir(tmp_path) == ["file"]
    finally:
        subprocess.run(["umount", tmp_path], check=True)
