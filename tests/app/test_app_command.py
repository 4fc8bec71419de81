"""The command line of the page, and what its server answers to whom."""

import socket
import sys

import pytest

from bt_jax.app.__main__ import Arguments, main


def refused(monkeypatch, capsys, *arguments):
    """The one sentence that the command says before it ends with code 2."""
    monkeypatch.setattr(sys, "argv", ["app", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    return said


def test_a_folder_that_is_not_there(monkeypatch, capsys, tmp_path):
    assert "make it, or give another" in refused(monkeypatch, capsys, "--folder", tmp_path / "nowhere", "--no-show")
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_cannot_be_used(monkeypatch, capsys, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = refused(monkeypatch, capsys, "--folder", tmp_path, "--port", port, "--no-show")
    assert f"127.0.0.1:{port} cannot be used" in said
    assert "choose another" in refused(monkeypatch, capsys, "--folder", tmp_path, "--port", 70_000, "--no-show")
    assert "choose another" in refused(monkeypatch, capsys, "--folder", tmp_path, "--host", "no.such.host", "--no-show")


def test_only_this_machine_may_open_the_page_unless_told_otherwise():
    assert Arguments().host == "127.0.0.1"
