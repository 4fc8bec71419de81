import pytest

from bt_jax.app.access.logins import Logins


@pytest.fixture
def logins(clock):
    return Logins("secret", clock)
