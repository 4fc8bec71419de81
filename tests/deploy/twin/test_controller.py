"""What the controller's process cannot do reaches its handle as a sentence."""

import socket
import time

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.protocol import ControllerGone
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.cells import cell


@pytest.fixture
def ports():
    return free_ports(YUMI.arm_names)


def test_a_call_that_is_refused_changes_nothing(ports):
    with Controller(cell(), ports=ports, realtime=False) as controller:
        for call, word in [
            (lambda: controller.fault("lightning"), "no fault 'lightning'"),
            (lambda: controller.fault("drop", colour=1.0), "colour"),
            (lambda: controller.put("nothing", RigidTransform.identity()), "nothing"),
            (lambda: controller.put("left_link", RigidTransform.identity()), "cannot be moved by hand"),
        ]:
            with pytest.raises(UserError, match=word):
                call()
        controller.advance(0.02)
        assert controller.stats().cycles == 5


def test_a_simulation_that_diverges_is_told_and_not_gone_on_with(ports):
    with Controller(cell(), ports=ports, realtime=False) as controller:
        controller.push("box", np.array([1e15, 0.0, 0.0]), 1.0)
        with pytest.raises(ControllerGone, match="the simulation diverged"):
            controller.advance(1.0)
        with pytest.raises(ControllerGone, match="ended"):
            controller.advance(2.0)


def test_in_real_time_the_next_call_tells_why_the_process_has_failed(ports):
    with Controller(cell(), ports=ports) as controller:
        controller.push("box", np.array([1e15, 0.0, 0.0]), 1.0)
        deadline = time.monotonic() + 10
        while controller.alive and time.monotonic() < deadline:
            time.sleep(0.02)
        with pytest.raises(ControllerGone, match=r"has failed .*the simulation diverged"):
            controller.messages()


def test_a_port_that_is_taken_is_told(ports):
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(UserError, match="address already in use"):
        Controller(cell(), ports=ports, rws_port=other.getsockname()[1]).start()


def test_a_cell_that_cannot_be_simulated_is_told(ports):
    broken = cell()
    object.__setattr__(broken, "xml", "<mujoco><nonsense/></mujoco>")
    with pytest.raises(UserError, match="nonsense"):
        Controller(broken, ports=ports).start()
