"""Preflight: every item is made to fail once, on a link whose time is simulated; once everything is real."""

import dataclasses
import io
import itertools
import json
import socket
import time
import types

import mujoco
import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution import preflight as module
from bt_jax.deploy.execution.equipment import Equipment
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.observation import Finding
from bt_jax.deploy.execution.preflight import passed, preflight, show
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.link.protocol import ArmState, Counters
from bt_jax.deploy.link.reception import Reception
from bt_jax.deploy.link.rws import ControllerState
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.network import free_ports
from bt_jax.mjx_env.scene.layouts import sample_layouts
from tests.helpers.cells import RULES, XML, running
from tests.helpers.ideal import STACK3, TASK, IdealCell, SimulatedTime, observe

OFF = RigidTransform.from_translation([0, 0, 0.01])
STRONG = dataclasses.replace(YUMI, arms=tuple(dataclasses.replace(arm, payload=2.0) for arm in YUMI.arms))
MODEL = mujoco.MjModel.from_xml_string(XML)


def flange(arm, joints):
    """MuJoCo's forward kinematics of the small cell."""
    data = mujoco.MjData(MODEL)
    for i, value in enumerate(joints, start=1):
        data.joint(f"{arm}_{i}").qpos[0] = value
    mujoco.mj_kinematics(MODEL, data)
    matrix = np.eye(4)
    matrix[:3, :3] = data.site(f"{arm}_flange").xmat.reshape(3, 3)
    matrix[:3, 3] = data.site(f"{arm}_flange").xpos
    return RigidTransform.from_matrix(matrix)


class Seeing:
    """Sees what is in a start layout, with images of now."""

    def __init__(self, link):
        self.link, self.image, self.lost, self.frozen, self.hidden, self.wrong = link, 0.0, "", False, (), ()

    def update(self):
        if not self.frozen:
            self.image = self.link.now()

    def poses(self, now):
        return observe(TASK, sample_layouts(TASK, 0, 1), unknown=self.hidden).poses

    def findings(self, now):
        return self.wrong

    def measured(self):
        return {}


@pytest.fixture(scope="module")
def twin_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("twin") / "log.jsonl"
    with Log(path) as log:
        IdealCell(log=log, settings={"robot": "twin"}).executor.run()
    return path


class CheckedCell(SimulatedTime):
    """A link to a controller that tells where the arms of the small cell are, every cycle of simulated time."""

    def __init__(self):
        super().__init__()
        self.rules, self.config = RULES, link_config(YUMI, "192.168.125.1", {"left": 6511, "right": 6512})
        self.control, self.lost, self.silent, self.others = "motoron", 0.0, (), {}

    def arm(self, arm):
        joints = np.full(7, 0.1)
        return ArmState(
            self.time, joints, np.zeros(7), joints, False, 0, 0.0, False, flange(arm, joints), 0.05, 0.05
        )  # fmt: skip

    def reception(self, arm):
        sent = round(self.time / CYCLE)
        taken = 0 if arm in self.silent else round((1 - self.lost) * sent)
        return Reception(taken=taken, sequence=sent, time=self.time)

    def elsewhere(self):
        return self.others

    def state(self):
        return ControllerState(self.control, "AUTO", "stopped")

    def counters(self):
        sent = round(2 * self.time / CYCLE)
        lost = round(self.lost * sent)
        return Counters(sent - lost, 0, 0, lost, 0, 0, 0)


@pytest.fixture
def good(twin_log):
    link = CheckedCell()
    return Equipment(
        robot=STRONG,
        program=Program(TASK, STACK3),
        rules=dataclasses.replace(RULES, lower=(-4.0,) * 7, upper=(4.0,) * 7),
        config=link.config,
        link=link,
        flange=flange,
        perception=Seeing(link),
        intrinsics_error=0.2,
        camera_residual=0.001,
        reachable=lambda name, seen: name in seen.poses,
        twin_log=twin_log,
        may_take_priority=lambda: True,
        gripper_mass=0.01,
    )


def test_a_good_cell_passes(good):
    items = list(preflight(good))
    assert passed(items), [item for item in items if not item.passed]
    assert len(items) == 17
    out = io.StringIO()
    for item in items:
        show(Console(file=out, width=120), item)
    assert out.getvalue().count("✓") == 17


def failing(cell):
    return {
        item.name.split(":")[0] + ":" + item.name.split(": ")[1].split()[0]: item
        for item in preflight(cell)
        if not item.passed
    }


@pytest.mark.parametrize(
    ("change", "name", "word"),
    [
        ({"twin_log": None}, "twin:this", "--twin-log"),
        ({"program": Program(TASK, STACK3.children[0])}, "twin:this", "another tree"),
        ({"flange": lambda arm, q: flange(arm, q) * OFF}, "arms:feedback", "10.0 mm"),
        ({"intrinsics_error": None}, "camera:intrinsics", "calibrate"),
        ({"intrinsics_error": 3.0}, "camera:intrinsics", "pixels"),
        ({"camera_residual": None}, "camera:pose", "calibrate"),
        ({"camera_residual": 0.02}, "camera:pose", "20.0 mm"),
        ({"perception": None}, "camera:images", "--camera"),
        ({"reachable": lambda name, seen: name != "BlueBox"}, "arms:every", "BlueBox"),
        ({"may_take_priority": lambda: False}, "computer:real-time", "rtprio"),
        ({"gripper_mass": 1.2}, "payload:boxes", "--gripper-mass"),
        ({"rules": RULES}, "arms:home", "may not rest at home"),
        ({"intrinsics_error": UserError("line 3 is broken")}, "camera:intrinsics", "line 3"),
    ],
)  # fmt: skip
def test_each_item_fails_with_its_remedy(good, change, name, word):
    found = failing(dataclasses.replace(good, **change))
    assert name in found
    assert word in found[name].detail
    assert all(item.passed is None for key, item in found.items() if key != name)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), -0.01])
def test_no_number_passes_that_is_none_or_cannot_be(good, value, monkeypatch):
    monkeypatch.setattr(module, "LISTEN", 0.3)
    for change, name in [
        ({"intrinsics_error": value}, "camera:intrinsics"),
        ({"camera_residual": value}, "camera:pose"),
        ({"gripper_mass": value}, "payload:boxes"),
    ]:
        assert name in failing(dataclasses.replace(good, **change))
    state = good.link.arm("left")
    for change, name in [
        ({"joints": np.where(np.arange(7) == 3, value, state.joints)}, "arms:joints"),
        ({"opening": value}, "grippers:position"),
    ]:
        if np.isfinite(value) and name == "arms:joints":
            continue
        with monkeypatch.context() as patch:
            patch.setattr(good.link, "arm", lambda arm, change=change: dataclasses.replace(state, **change))
            assert name in failing(good)


def test_fingers_are_judged_by_the_robots_gripper_whatever_the_task_says(good, monkeypatch):
    state = good.link.arm("left")
    roomy = Program(dataclasses.replace(TASK, gripper_opening=0.2), STACK3)
    wide = dataclasses.replace(good.robot.arms[0].gripper, stroke=0.06)
    arms = tuple(dataclasses.replace(arm, gripper=wide) for arm in good.robot.arms)
    monkeypatch.setattr(good.link, "arm", lambda arm: dataclasses.replace(state, opening=0.1))
    assert "grippers:position" in failing(dataclasses.replace(good, program=roomy))
    assert "grippers:position" not in failing(
        dataclasses.replace(good, robot=dataclasses.replace(good.robot, arms=arms))
    )


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), 1e6])
def test_one_image_of_an_impossible_time_fails(good, odd, monkeypatch):
    monkeypatch.setattr(module, "LISTEN", 0.3)
    looks = itertools.count()
    good.perception.update = lambda: setattr(good.perception, "image", odd if next(looks) == 2 else good.link.now())
    assert "camera:images" in failing(good)


def test_what_cannot_be_opened_fails_alone(good, monkeypatch):
    monkeypatch.setattr(module, "LISTEN", 0.3)
    seeing = Seeing(types.SimpleNamespace(now=time.monotonic))
    found = failing(dataclasses.replace(good, link=UserError("no controller was named"), perception=seeing))
    assert found.pop("controller:state").detail == "no controller was named"
    assert {name: item.passed for name, item in found.items()} == dict.fromkeys(
        ("link:feedback", "arms:joints", "arms:feedback", "grippers:position")
    )
    found = failing(dataclasses.replace(good, program=UserError("there is no tree")))
    assert found.pop("tree:every").detail == "there is no tree"
    assert {"twin:this", "payload:boxes", "markers:everything"} <= set(found)
    assert not {"controller:state", "link:feedback", "camera:pose", "computer:UDP"} & set(found)


def test_a_port_that_another_program_has_is_named(good):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        port = other.getsockname()[1]
        config = dataclasses.replace(good.config, ports={"left": port, "right": free_ports(("right",))["right"]})
        found = failing(dataclasses.replace(good, link=UserError("none"), config=config, perception=None))
        assert f"UDP port {port} cannot be used" in found["computer:UDP"].detail


def test_a_frozen_camera_and_a_hidden_box_fail(good):
    good.perception.frozen = True
    found = failing(good)
    assert "old" in found["camera:images"].detail
    assert found["markers:everything"].passed is None
    good.perception.frozen, good.perception.hidden = False, ("GreenBox",)
    assert "GreenBox" in failing(good)["markers:everything"].detail


def test_what_is_wrong_with_the_picture_fails(good):
    good.perception.wrong = (Finding("", "the camera has moved"), Finding("BlueBox", "BlueBox is tilted"))
    found = failing(good)
    assert found["camera:nothing"].detail == "the camera has moved; BlueBox is tilted"
    assert len(found) == 1


def test_a_camera_that_raises_does_not_end_the_other_looks(good):
    def lost():
        raise OSError("no such device")

    good.perception.update = lost
    items = list(preflight(good))
    assert len(items) == 17
    assert any("no such device" in item.detail for item in items)


def test_a_joint_near_its_limit_fails(good, monkeypatch):
    tight = dataclasses.replace(RULES, upper=(0.11,) * 7)
    monkeypatch.setattr(good.link, "rules", tight)
    assert "jog" in failing(good)["arms:joints"].detail


@pytest.mark.parametrize(
    ("change", "item"),
    [
        ({"joints": np.full(7, np.nan)}, "arms:joints"),
        ({"flange": None}, "arms:feedback"),
        ({"opening": np.nan}, "grippers:position"),
    ],
)
def test_an_arm_that_tells_what_is_not_a_number_fails(good, monkeypatch, change, item):
    told = good.link.arm
    monkeypatch.setattr(good.link, "arm", lambda arm: dataclasses.replace(told(arm), **change))
    assert item in failing(good)


@pytest.mark.filterwarnings("error")
def test_joints_that_are_not_finite_are_named_before_anything_is_computed_from_them(good, monkeypatch):
    told = good.link.arm
    odd = {"joints": np.array([0.1] * 6 + [np.inf])}
    monkeypatch.setattr(good.link, "arm", lambda arm: dataclasses.replace(told(arm), **odd))
    good.perception.wrong = (Finding("BlueBox", "BlueBox is hidden", sight=((1.0, 0.0, 1.0), (0.4, 0.0, 0.0))),)
    found = failing(good)
    assert {"arms:joints", "arms:feedback", "camera:nothing"} == set(found)
    assert "not finite" in found["arms:joints"].detail
    assert "not finite" in found["arms:feedback"].detail
    assert found["camera:nothing"].detail == "BlueBox is hidden"


def test_kinematics_and_images_that_are_not_numbers_fail(good):
    nowhere = RigidTransform.from_translation([np.nan, 0, 0])
    assert "arms:feedback" in failing(dataclasses.replace(good, flange=lambda arm, joints: nowhere))
    good.perception.frozen, good.perception.image = True, np.nan
    assert "camera:images" in failing(good)


def test_a_twin_run_that_failed_does_not_count(good, twin_log, tmp_path):
    lines = twin_log.read_text().splitlines()
    end = json.loads(lines[-1])
    end["exit_code"] = 1
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join([*lines[:-1], json.dumps(end)]))
    found = failing(dataclasses.replace(good, twin_log=path))
    assert "did not succeed" in found["twin:this"].detail
    path.write_text("\n".join([*lines[:2], "garbage", *lines[2:]]))
    found = failing(dataclasses.replace(good, twin_log=path))
    assert "line 3 is not part of a log" in found["twin:this"].detail


def test_a_run_on_a_robot_is_none_in_the_twin(good, twin_log, tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_text(
        twin_log.read_text().replace('"robot": "twin"', '"preflight": []').replace('"robot":"twin"', '"preflight":[]')
    )
    found = failing(dataclasses.replace(good, twin_log=path))
    assert "not of the twin" in found["twin:this"].detail


def test_lost_messages_and_a_silent_arm_fail(good):
    good.link.lost = 0.3
    assert "lost" in failing(good)["link:feedback"].detail
    good.link.lost, good.link.silent = 0.0, ("right",)
    assert "right arm" in failing(good)["link:feedback"].detail
    good.link.others = {6510: "192.168.125.1"}
    assert "come to 6510 (from 192.168.125.1); name the ports" in failing(good)["link:feedback"].detail


def test_a_controller_that_is_not_ready_fails(good):
    good.link.control = "emergencystop"
    found = failing(good)
    assert "emergencystop" in found["controller:state"].detail
    assert "link:feedback" not in found, "its arms may tell where they are nevertheless"


@pytest.mark.realtime
def test_a_real_link_passes(good, monkeypatch):
    monkeypatch.setattr(module, "LISTEN", 0.6)
    with running(realtime=True, start=False) as (_, link):
        items = list(preflight(dataclasses.replace(good, link=link, perception=Seeing(link))))
        assert passed(items), [item for item in items if not item.passed]


def test_before_a_recovery_a_joint_may_be_near_its_limit_but_must_be_possible(good, monkeypatch):
    link = good.link
    state = link.arm("left")
    for off, fine in ((0.0, True), (np.radians(10.0), False), (np.nan, False)):
        joints = np.array(link.rules.upper) + off
        monkeypatch.setattr(link, "arm", lambda arm, joints=joints: dataclasses.replace(state, joints=joints))
        found = {item.name: item.passed for item in preflight(good, {module.PLAUSIBLE})}
        assert found == {module.PLAUSIBLE: fine}
