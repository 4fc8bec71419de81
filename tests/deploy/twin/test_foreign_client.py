"""A client that knows nothing of this package drives the twin: ABBRobotEGM, as its documentation shows it."""

import threading

import numpy as np
import pytest

from bt_jax.deploy.link.egm import EXTERNAL
from bt_jax.deploy.link.rws import EGM_REQUEST, Motion, Rws, symbol
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.rws_server import PASSWORD, USER
from bt_jax.deploy.twin.settings import Realism
from tests.helpers.cells import ARMS, cell

EGM = pytest.importorskip("ABBRobotEGM", reason="ABBRobotEGM is not installed").EGM
CHANGE = np.array([5.0, -4.0, 3.0, 2.0, -6.0, 7.0])  # deg, of ABB's axes 1 to 6
SEVENTH = 8.0
SECONDS = 1.5


class Client(threading.Thread):
    """Turns one arm by CHANGE and SEVENTH, 0.05 deg a message, as long as messages come."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.egm, self.states, self.closing = EGM(port), [], False

    def run(self) -> None:
        goal = None
        while not self.closing:
            success, state = self.egm.receive_from_robot(0.1)
            if not success:
                continue
            self.states.append(state)
            if goal is None:
                joints, seventh = state.joint_angles.copy(), state.external_axes.copy()
                goal = joints + CHANGE, seventh + SEVENTH
            joints = joints + np.clip(goal[0] - joints, -0.05, 0.05)
            seventh = seventh + np.clip(goal[1] - seventh, -0.05, 0.05)
            if not self.egm.send_to_robot(joint_angles=joints, external_joints=seventh):
                return
        self.egm.close()


def seven(axes, seventh):
    """ABB's axes 1 to 6 and 7 in the order of the chain."""
    return np.insert(axes, EXTERNAL, seventh)


@pytest.mark.parametrize("realism", [Realism.perfect(), Realism()], ids=["perfect", "real"])
def test_a_foreign_client_moves_both_arms_with_all_seven_axes(realism):
    ports = free_ports(YUMI.arm_names)
    clients = {arm: Client(port) for arm, port in ports.items()}
    for client in clients.values():
        client.start()
    try:
        with Controller(cell(), ports=ports, realtime=False, realism=realism) as controller:
            start = controller.state()[1]
            controller.advance(0.1)
            rws = Rws("127.0.0.1", controller.rws_port, USER, PASSWORD)
            rws.start()
            for arm in ARMS:
                rws.set_number(symbol(arm, EGM_REQUEST), float(Motion.GUIDED))
            controller.advance(0.1 + SECONDS)
            turned = np.degrees(controller.state()[1] - start)
            rws.close()
            assert controller.messages() == []
    finally:
        for client in clients.values():
            client.closing = True
            client.join()
    for number, arm in enumerate(ARMS):
        np.testing.assert_allclose(turned[7 + 9 * number : 14 + 9 * number], seven(CHANGE, SEVENTH), atol=0.1)
        first, last = clients[arm].states[0], clients[arm].states[-1]
        assert (first.rapid_running, first.mci_state) == (False, 2)
        assert (last.rapid_running, last.motors_on, last.mci_state) == (True, True, 3)
        np.testing.assert_allclose(last.joint_angles - first.joint_angles, CHANGE, atol=0.1)
        np.testing.assert_allclose(last.external_axes - first.external_axes, [SEVENTH], atol=0.1)
        assert last.cartesian is not None
        numbers = [state.header.seqno for state in clients[arm].states if state.mci_state == 3]
        assert np.diff(numbers).min() == 1
        assert last.clock is not None
