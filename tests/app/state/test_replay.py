import pytest

from bt_jax.app.state.replay import described
from bt_jax.behaviors.geometry import GEOMETRY
from bt_jax.lfd import Action, Pose
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT
from bt_jax.tasks import load_task

TASK = load_task("stack3")
SIZE = TASK.objects[0].edge


def placed(over, height):
    """GreenBox is released at a height over YellowBox, in box sizes, and `over` metres beside; far from all else."""
    far = {name: Pose((5.0, 0.0, 0.0)) for name in (TASK.kits[0].name, "BlueBox", TASK.robot_frame)}
    at = {name: Pose((over, 0.0, height * SIZE + END_EFFECTOR_HEIGHT)) for name in ("GreenBox", "YellowBox")}
    return Action("place", far | at)


@pytest.mark.parametrize(
    ("over", "height", "on"),
    [
        (0.0, 1.0, True),
        (0.0, GEOMETRY.above_least - 0.01, False),
        (0.0, GEOMETRY.above_most + 0.1, True),  # it falls a little when it is released
        (0.0, 1.6, False),
        (0.9 * SIZE, 1.0, True),
        (1.1 * SIZE, 1.0, False),
    ],
)
def test_what_is_put_on_a_box_is_told_by_that_box(over, height, on):
    assert ("YellowBox" in described(placed(over, height), "GreenBox", TASK)) == on
