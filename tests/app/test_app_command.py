"""The command line of the page, and what its server answers to whom."""

import socket
import sys

import pytest

from bt_jax.app.__main__ import Arguments, main, run


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


def test_a_missing_folder_is_created(monkeypatch, tmp_path):
    served = []
    monkeypatch.setattr("bt_jax.app.server.serve", lambda folder, **_: served.append(folder.is_dir()))
    monkeypatch.setattr("bt_jax.app.__main__.WarmWorker", lambda: None)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    run(Arguments(folder=tmp_path / "a" / "b", port=port, show=False))
    assert served == [True]


def test_a_folder_that_cannot_be_created(monkeypatch, capsys, tmp_path):
    (tmp_path / "file").write_text("")
    said = refused(monkeypatch, capsys, "--folder", tmp_path / "file" / "work", "--port", 0, "--no-show")
    assert "cannot be created" in said
    assert "give another --folder" in said


def test_a_port_that_cannot_be_used(monkeypatch, capsys, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = refused(monkeypatch, capsys, "--folder", tmp_path, "--port", port, "--no-show")
    assert f"127.0.0.1:{port} cannot be used" in said
    assert "choose another" in refused(monkeypatch, capsys, "--folder", tmp_path, "--port", 70_000, "--no-show")
    assert "choose another" in refused(monkeypatch, capsys, "--folder", tmp_path, "--host", "no.such.host", "--no-show")


def test_only_this_machine_may_open_the_page_unless_told_otherwise():
    assert Arguments().host == "127.0.0.1"
