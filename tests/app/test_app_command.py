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


def test_a_folder_that_another_page_works_in(monkeypatch, capsys, tmp_path):
    def serve(folder, **_):
        said.append(refused(monkeypatch, capsys, "--folder", folder, "--port", 0, "--no-show"))

    said = []
    monkeypatch.setattr("bt_jax.app.server.serve", serve)
    monkeypatch.setattr("bt_jax.app.__main__.WarmWorker", lambda: None)
    for _ in range(2):  # and not any more, once that one has ended
        run(Arguments(folder=tmp_path, port=0, show=False))
    assert [f"another page works in {tmp_path}; open that one" in each for each in said] == [True, True]


def test_a_port_that_cannot_be_used(monkeypatch, capsys, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = refused(monkeypatch, capsys, "--folder", tmp_path, "--port", port, "--no-show")
    assert f"127.0.0.1:{port} cannot be used" in said
    assert "choose another" in refused(monkeypatch, capsys, "--folder", tmp_path, "--port", 70_000, "--no-show")
    for host in ("no.such.host", "a..b"):
        assert "choose another" in refused(monkeypatch, capsys, "--folder", tmp_path, "--host", host, "--no-show")


def ipv6_port():
    """A port of loopback that is taken by nobody; without IPv6, the test is left out."""
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6) as probe:
            return probe.getsockname()[1]
    except OSError:
        pytest.skip("there is no IPv6 here")


def test_the_page_is_served_at_an_address_of_ipv6(monkeypatch, capsys, tmp_path):
    ipv6_port()
    told, said = served(monkeypatch, capsys, tmp_path, host="::1")
    assert (told["host"], told["token"], told["show"]) == ("::1", "", False)
    assert "the page is at http://[::1]:" in said


def test_a_port_of_ipv6_that_cannot_be_used(monkeypatch, capsys, tmp_path):
    port = ipv6_port()
    with socket.create_server(("::1", port), family=socket.AF_INET6):
        said = refused(monkeypatch, capsys, "--folder", tmp_path, "--host", "::1", "--port", port, "--no-show")
    assert f"[::1]:{port} cannot be used" in said


def test_how_long_a_window_keeps_what_it_has(monkeypatch, capsys, tmp_path):
    assert served(monkeypatch, capsys, tmp_path)[0]["hold_factor"] == 1
    assert served(monkeypatch, capsys, tmp_path, hold_factor=3.0)[0]["hold_factor"] == 3
    for factor in ("0", "nan", "inf"):
        said = refused(monkeypatch, capsys, "--folder", tmp_path, "--no-show", "--hold-factor", factor)
        assert "use 0.1 to 1000" in said


def served(monkeypatch, capsys, tmp_path, **given):
    """What the server is told, and what the terminal says."""
    told = {}
    monkeypatch.setattr("bt_jax.app.server.serve", lambda folder, **more: told.update(more))
    monkeypatch.setattr("bt_jax.app.__main__.WarmWorker", lambda: None)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    run(Arguments(folder=tmp_path, port=port, **given))
    return told, capsys.readouterr().out


def test_only_this_machine_may_open_the_page_unless_told_otherwise(monkeypatch, capsys, tmp_path):
    told, said = served(monkeypatch, capsys, tmp_path)
    assert (told["host"], told["names"], told["token"], told["show"]) == ("127.0.0.1", frozenset(), "", "/")
    assert "token" not in said


@pytest.mark.parametrize(
    ("given", "names"), [({"host": "0.0.0.0"}, {"0.0.0.0"}), ({"allow_host": ("Lab-PC", "localhost")}, {"lab-pc"})]
)
def test_whoever_comes_from_elsewhere_needs_the_token_that_is_printed(monkeypatch, capsys, tmp_path, given, names):
    told, said = served(monkeypatch, capsys, tmp_path, **given)
    assert told["names"] == names
    assert len(told["token"]) >= 16
    assert f"/login?token={told['token']} " in said
    assert f"token {told['token']}; a login lasts 12 hours" in said
    assert told["show"] == f"/login?token={told['token']}"


def test_a_name_that_is_none(monkeypatch, capsys, tmp_path):
    said = refused(monkeypatch, capsys, "--folder", tmp_path, "--no-show", "--allow-host", "http://lab-pc:8080")
    assert "--allow-host http://lab-pc:8080 is not the name of a host; give it without http:// and port" in said
