import pytest

from bt_jax.deploy.commands.twin import overall_exit_code
from bt_jax.deploy.execution.settings import Exit


@pytest.mark.parametrize(
    ("codes", "overall"),
    [
        ([Exit.DONE, Exit.DONE], Exit.DONE),
        ([Exit.DONE, Exit.FAILED], Exit.FAILED),
        ([Exit.FAILED, Exit.STOPPED, Exit.DONE], Exit.STOPPED),
    ],
)
def test_a_protective_stop_in_any_layout_is_told(codes, overall):
    assert overall_exit_code(codes) == overall
