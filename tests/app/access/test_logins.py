"""The token and the logins, with a clock that the test sets."""

import pytest

from bt_jax.app.access.logins import LOGIN_HOURS, WRONG_SECONDS, WRONG_TOKENS, new_token


def test_tokens_differ_and_are_typed_easily():
    assert len({new_token() for _ in range(100)}) == 100
    assert new_token().isalnum()


def test_the_token_gives_a_login_that_expires(logins, clock):
    key = logins.log_in(" secret\n", "a")
    assert logins.left(key) == pytest.approx(3600 * LOGIN_HOURS)
    clock.now += 3600 * LOGIN_HOURS - 1
    assert logins.left(key) == pytest.approx(1)
    clock.now += 1
    assert logins.left(key) == 0


def test_each_login_has_a_key_of_its_own(logins):
    assert logins.log_in("secret", "a") != logins.log_in("secret", "a")


@pytest.mark.parametrize("token", ["", "secre", "secrets", "SECRET", "ʁ", "secret secret"])
def test_another_token_gives_none(logins, token):
    assert logins.log_in(token, "a") is None
    assert logins.left(token) == 0


def test_wrong_tokens_are_limited_for_each_address(logins, clock):
    for _ in range(WRONG_TOKENS):
        assert logins.wait("a") == 0
        logins.log_in("wrong", "a")
        clock.now += 1
    assert logins.wait("a") == pytest.approx(WRONG_SECONDS - WRONG_TOKENS)
    assert logins.wait("b") == 0
    clock.now += WRONG_SECONDS - WRONG_TOKENS
    assert logins.wait("a") == 0
