import dataclasses
import math

import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.twin.settings import Realism

ENDLESS = {"rate", "egm_speed", "requests", "contact"}


def test_a_perfect_cell_has_no_errors_and_no_limits():
    perfect = Realism.perfect()
    assert perfect.scaled(1.5) == dataclasses.replace(perfect, finger_speed=perfect.finger_speed / 1.5)
    assert {name for name, value in vars(perfect).items() if value == math.inf} == ENDLESS
    assert {name for name, value in perfect.logged().items() if value is None} == ENDLESS


def test_a_worse_cell_has_larger_errors_and_lower_limits():
    real, worse = Realism(exposure=-1.0, camera_moved=(0.0, 0.01, -0.02)), None
    worse = real.scaled(2.0)
    assert (worse.width, worse.height) == (real.width, real.height)
    assert worse.exposure == -2.0
    assert worse.camera_moved == (0.0, 0.02, -0.04)
    for name, value in vars(real).items():
        if name in ("rate", "egm_speed", "finger_speed", "requests", "contact"):
            assert getattr(worse, name) == value / 2, name
        elif name not in ("width", "height", "camera_moved", "camera_turned"):
            assert getattr(worse, name) == value * 2, name


@pytest.mark.parametrize(
    "wrong",
    [
        {"blur": -0.1},
        {"noise": math.nan},
        {"egm_lag": math.inf},
        {"contact": 0.0},
        {"rate": -15.0},
        {"width": 8},
        {"camera_moved": (0.0, math.nan, 0.0)},
    ],
)
def test_values_that_cannot_be_are_refused(wrong):
    with pytest.raises(UserError, match=next(iter(wrong)) if "width" not in wrong else "pixels"):
        Realism(**wrong).check()
    Realism().check()
    Realism.perfect().check()
