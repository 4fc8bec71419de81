"""Names and addresses of hosts."""

import pytest

from bt_jax.app.access.address import is_loopback, is_name


@pytest.mark.parametrize("name", ["127.0.0.1", "127.8.9.10", "::1", "localhost", "LocalHost"])
def test_loopback(name):
    assert is_loopback(name)


@pytest.mark.parametrize("name", ["0.0.0.0", "::", "10.0.0.1", "localhost.evil.example", "lab-pc", ""])
def test_not_loopback(name):
    assert not is_loopback(name)


@pytest.mark.parametrize("name", ["lab-pc", "Robot.example.org", "192.168.1.5", "fe80::1"])
def test_names(name):
    assert is_name(name)


@pytest.mark.parametrize("name", ["", "http://lab-pc", "lab-pc:8080", "lab pc", "lab-pc/", "*", "a@b"])
def test_what_is_no_name(name):
    assert not is_name(name)
