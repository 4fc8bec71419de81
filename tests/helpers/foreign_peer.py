"""The robot's side of a link, made of the messages of ABBRobotEGM, which others have compiled from ABB's own file."""

import socket
import threading
import time

import numpy as np
import pytest

from bt_jax.deploy.link.rws import EGM_REQUEST, EGM_STATE, Motion, symbol

egm_pb2 = pytest.importorskip("ABBRobotEGM._egm_protobuf.egm_pb2", reason="ABBRobotEGM is not installed")
CYCLE = 0.004


class ForeignArm:
    """ABB's axes 1 to 6 and axis 7, the external joint [deg], of an arm that does at once what it is told."""

    def __init__(self, arm: str, host: str) -> None:
        self.request, self.state = symbol(arm, EGM_REQUEST), symbol(arm, EGM_STATE)
        self.axes, self.seventh = np.linspace(2.0, 7.0, 6), 8.0
        self.told: list[np.ndarray] = []
        self.sequence, self.running = 0, False
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.socket.setblocking(False)

    def message(self, now: float, *, seventh: bool) -> bytes:
        """A message with everything that a controller of a newer version puts into it."""
        self.sequence += 1
        robot = egm_pb2.EgmRobot()
        robot.header.seqno, robot.header.tm = self.sequence, round(1000 * now)
        robot.header.mtype = egm_pb2.EgmHeader.MSGTYPE_DATA
        for part in (robot.feedBack, robot.planned):
            part.joints.joints.extend(self.axes)
            if seventh:
                part.externalJoints.joints.extend([self.seventh, 0.0, 0.0, 0.0, 0.0, 0.0])
            part.cartesian.pos.x, part.cartesian.pos.y, part.cartesian.pos.z = 300.0, 100.0, 200.0
            orient = part.cartesian.orient
            orient.u0, orient.u1, orient.u2, orient.u3 = 0.0, 1.0, 0.0, 0.0
            part.time.sec, part.time.usec = int(now), round(1e6 * (now % 1))
        robot.motorState.state = egm_pb2.EgmMotorState.MOTORS_ON
        robot.mciState.state = egm_pb2.EgmMCIState.MCI_RUNNING if self.running else egm_pb2.EgmMCIState.MCI_STOPPED
        robot.mciConvergenceMet = False
        robot.rapidExecState.state = egm_pb2.EgmRapidCtrlExecState.RAPID_RUNNING
        robot.testSignals.signals.extend([0.5, 0.25])
        robot.measuredForce.force.extend([0.0] * 6)
        robot.utilizationRate, robot.moveIndex = 12.5, 3
        return robot.SerializeToString()

    def listen(self) -> None:
        """Do what the setpoints say."""
        while True:
            try:
                data = self.socket.recv(4096)
            except OSError:
                return
            sensor = egm_pb2.EgmSensor.FromString(data)
            assert sensor.header.mtype == egm_pb2.EgmHeader.MSGTYPE_CORRECTION
            assert len(sensor.planned.joints.joints) == 6
            assert len(sensor.planned.externalJoints.joints) == 1
            self.told.append(np.array([*sensor.planned.joints.joints, *sensor.planned.externalJoints.joints]))
            if self.running:
                self.axes, self.seventh = self.told[-1][:6], float(self.told[-1][6])


class ForeignPeer(threading.Thread):
    """Sends for each arm every 4 ms; `controller` is what Robot Web Services act on. `host` is where messages come from."""

    def __init__(self, controller, ports, *, host: str = "127.0.0.1", seventh: bool = True) -> None:
        super().__init__(daemon=True)
        self.controller, self.ports, self.seventh = controller, ports, seventh
        self.arms = {arm: ForeignArm(arm, host) for arm in ports}
        self.closing = threading.Event()

    def run(self) -> None:
        began = time.monotonic()
        cycle = 0
        while not self.closing.wait(max(0.0, began + cycle * CYCLE - time.monotonic())):
            cycle += 1
            for name, arm in self.arms.items():
                arm.listen()
                if self.controller.numbers[arm.request] == Motion.GUIDED:
                    self.controller.numbers[arm.state], arm.running = float(Motion.GUIDED), True
                data = arm.message(cycle * CYCLE, seventh=self.seventh)
                arm.socket.sendto(data, ("127.0.0.1", self.ports[name]))

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.closing.set()
        self.join()
        for arm in self.arms.values():
            arm.socket.close()
