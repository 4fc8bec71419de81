"""A small cell for the link's tests: two arms of seven joints, fingers, and a box that falls."""

import contextlib
from collections.abc import Callable

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.protocol import ControllerGone
from bt_jax.deploy.link.safety import Rejected, Rules
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.simulated_robot import CellModel

ARMS = ("left", "right")
STARVED = 0.05  # seconds; a cycle has 4 ms
RULES = Rules(
    lower=(-2.0,) * 7, upper=(2.0,) * 7, speed=(3.0,) * 7, acceleration=(20.0,),
    lowest=YUMI.workspace[0], highest=YUMI.workspace[1], stale=0.3,  # a shared machine may stall
)  # fmt: skip


def _arm(name: str, y: float) -> str:
    axes = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    body = ""
    for i, axis in enumerate(axes):
        position = f"0 {y} 0.2" if i == 0 else "0 0 0.08"
        title = f' name="{name}_link"' if i == 6 else ""
        body += (
            f'<body{title} pos="{position}" gravcomp="1"><joint name="{name}_{i + 1}" axis="{axis}" range="-2.2 2.2" '
            f'armature="0.05" damping="1"/><geom type="capsule" fromto="0 0 0 0 0 0.08" size="0.02" mass="0.3"/>'
        )
    for finger, sign in (("a", 1), ("b", -1)):
        body += (
            f'<body pos="0 {0.006 * sign} 0.1" gravcomp="1"><joint name="{name}_{finger}" type="slide" axis="0 {sign} 0" '
            f'range="0 0.025" damping="5"/><geom type="box" size="0.008 0.005 0.02" mass="0.03"/></body>'
        )
    return body + f'<site name="{name}_flange" pos="0 0 0.08"/>' + "</body>" * 7


def _actuators(name: str) -> str:
    arms = "".join(f'<position name="{name}_{i}" joint="{name}_{i}" kp="400" kv="20"/>' for i in range(1, 8))
    return arms + "".join(f'<position name="{name}_{f}" joint="{name}_{f}" kp="2000" kv="20"/>' for f in "ab")


XML = f"""<mujoco><compiler angle="radian"/><option timestep="0.002"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<geom type="plane" size="2 2 1" contype="1" conaffinity="1"/>
<body name="box" pos="0.5 0 0.05"><freejoint/><geom type="box" size=".02 .02 .02" contype="1" conaffinity="1"/></body>
{_arm("left", 0.3)}{_arm("right", -0.3)}</worldbody>
<actuator>{_actuators("left")}{_actuators("right")}</actuator></mujoco>"""


def cell() -> CellModel:
    return CellModel(
        xml=XML,
        assets={},
        qpos=np.array([0.5, 0, 0.05, 1, 0, 0, 0] + ([0.1] * 7 + [0.025] * 2) * 2),
        joints={arm: tuple(f"{arm}_{i}" for i in range(1, 8)) for arm in ARMS},
        actuators={arm: tuple(f"{arm}_{i}" for i in range(1, 8)) for arm in ARMS},
        finger_joints={arm: (f"{arm}_a", f"{arm}_b") for arm in ARMS},
        finger_actuators={arm: (f"{arm}_a", f"{arm}_b") for arm in ARMS},
        flanges={arm: f"{arm}_flange" for arm in ARMS},
        grippers={arm: YUMI.arm(arm).gripper for arm in ARMS},
    )


@contextlib.contextmanager
def running(*, realtime: bool, rules: Rules = RULES, start: bool = True):
    """A controller and a link to it: (controller, link). Skips what fails in real time on a starved machine."""
    ports = free_ports(YUMI.arm_names)
    with Controller(cell(), ports=ports, realtime=realtime) as controller:
        config = link_config(YUMI, "127.0.0.1", ports, controller.rws_port, motion=True)
        link = Irc5Link(config, rules, controller)
        with skipped_where_starved(controller, link), link:
            if start:
                link.start()
            yield controller, link


@contextlib.contextmanager
def skipped_where_starved(controller: Controller, *links: Irc5Link, busy: Callable[[], str] = str):
    """Skip a test that fails while controller or links come too late, or `busy` says what else did. Where time is simulated,
    that never happens."""
    try:
        yield
    except (AssertionError, TypeError, ControllerGone, Rejected, UserError, pytest.fail.Exception) as failure:
        stats = controller.stats()
        worst = max([stats.worst, *(late.late for link in links for late in link.late_rounds())])
        if controller.realtime and (worst > STARVED or stats.missed > 0.02 * stats.cycles or busy()):
            pytest.skip(f"this machine is too busy for real time, {1000 * worst:.0f} ms late {busy()}: {failure}")
        raise


def run_for(link, seconds: float, *, tick: float = 0.05, until=lambda: False) -> None:
    """Lets time pass in ticks."""
    end = link.now() + seconds
    while link.now() < end - 1e-6 and not until():
        link.wait(min(link.now() + tick, end))


def smooth(start, goal, seconds: float = 1.0) -> Trajectory:
    """A straight path from rest to rest, with the least jerk."""
    times = np.linspace(0, seconds, max(2, round(seconds / CYCLE) + 1))
    part = times / seconds
    share = part**3 * (10 - 15 * part + 6 * part**2)
    return Trajectory(times, np.asarray(start) + share[:, None] * (np.asarray(goal) - start))


def move(link, arm: str = "left", by: float = 0.3, seconds: float = 1.0) -> int:
    """Starts a path that turns every joint by some angle [rad]; gives its number."""
    start = link.arm(arm).commanded
    return link.follow(arm, smooth(start, start + by, seconds))
