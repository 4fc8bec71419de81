import numpy as np
import pytest

from bt_jax.lfd.contact import supports
from bt_jax.lfd.evaluation.synthetic import demonstrate
from bt_jax.tasks import Target
from tests.helpers.demonstrations import STACK3, STACKING, UNSTACKING


@pytest.mark.parametrize(
    ("placements", "below"),
    [
        (STACKING[:1], ("KittingBox",)),
        (STACKING[:2], ("YellowBox",)),
        (STACKING, ("GreenBox",)),
        (UNSTACKING[:1], ("base_link",)),
        ([STACKING[0], Target("GreenBox", (0.0, 0.0, 0.13), "YellowBox")], ("YellowBox",)),  # it falls a little
        ([STACKING[0], Target("GreenBox", (0.12, 0.0, 0.0), "YellowBox")], ("KittingBox",)),  # it stands beside it
        (
            [
                Target("YellowBox", (-0.06, 0.0, 0.052), "KittingBox"),
                Target("GreenBox", (0.12, 0.0, 0.0), "YellowBox"),
                Target("BlueBox", (0.06, 0.0, 0.1), "YellowBox"),
            ],
            ("YellowBox", "GreenBox"),
        ),
    ],
)
def test_what_a_box_is_put_on(placements, below):
    last = demonstrate(STACK3, placements, rng=np.random.default_rng(0)).actions[-1]
    assert supports(last, placements[-1].object, STACK3) == below
