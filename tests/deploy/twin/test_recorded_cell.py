import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.recorded import RecordedMoment, RecordedRun
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.recorded_cell import RecordedCell
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.mjx_env.render.offscreen import available
from bt_jax.tasks import load_task

pytestmark = pytest.mark.skipif(available() is not True, reason=f"pictures need a renderer: {available()}")
PROGRAM = Program(load_task("yumi_stack"), parse_tree("pick(YellowBox)"))
OPEN = {"left": 0.05, "right": 0.05}


def moment(time, poses, *, joints=None, holding=None):
    known = {name: RigidTransform.from_translation(place) for name, place in poses.items()}
    return RecordedMoment(time, Observation(time, known, OPEN, holding), (None,), "acting", None, joints or {}, ())


def test_arms_and_objects_are_drawn_where_they_were_and_what_is_held_goes_with_the_hand():
    there, home = [0.3, 0.24, 0.02], YUMI.home["left"]
    lifted = home + np.array([0, 0, 0, 0.3, 0, 0, 0])
    tip = YUMI.forward("left", home).translation
    moments = (
        moment(0.0, {}),
        moment(1.0, {"YellowBox": there}),
        moment(2.0, {}),
        moment(3.0, {"YellowBox": tip}, holding="YellowBox"),
        moment(4.0, {}, joints={"left": lifted}, holding="YellowBox"),
    )
    cell = RecordedCell(YUMI, RecordedRun(PROGRAM, moments, 0, "", False, 0), width=800, height=450)
    try:
        unknown, seen, hidden, held, carried = (cell(at).astype(int) for at in range(5))
    finally:
        cell.close()

    def yellow(picture):
        return np.argwhere((picture[..., 0] > 150) & (picture[..., 1] > 100) & (picture[..., 2] < 90))

    assert len(yellow(unknown)) == 0
    assert len(yellow(seen)) > 10
    assert np.array_equal(seen, hidden)  # where it was seen last
    assert np.linalg.norm(yellow(held).mean(0) - yellow(seen).mean(0)) > 5
    assert np.linalg.norm(yellow(carried).mean(0) - yellow(held).mean(0)) > 2
