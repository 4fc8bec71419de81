import pytest

from bt_jax.app.units import in_metres, in_millimetres, length


@pytest.mark.parametrize("metres", [0.0, 0.055, -0.133, 1.2345])
def test_what_is_shown_may_be_written_back(metres):
    assert in_metres(in_millimetres(metres)) == pytest.approx(metres, abs=5e-4)


def test_numbers_are_rounded_and_zero_has_no_sign():
    assert in_millimetres(0.13333333) == 133
    assert f"{in_millimetres(-1e-9):g}" == "0"
    assert length(0.1064) == "106 mm"
    assert length(0.0015) == "2 mm"
