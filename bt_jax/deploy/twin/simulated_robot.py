"""The simulated cell and the robot in it: MuJoCo, EGM for each arm, grippers, and what a RAPID program would do."""

from __future__ import annotations

import dataclasses
import math
import select
import socket
import time
from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci, Setpoint
from bt_jax.deploy.link.rws import (
    EGM_HERE,
    EGM_REQUEST,
    EGM_STATE,
    GRIP_ACTUAL,
    GRIP_FORCE,
    GRIP_TARGET,
    ControllerMessage,
    Motion,
    symbol,
)
from bt_jax.deploy.robot.arrays import PoseRow
from bt_jax.deploy.robot.model import GripperModel
from bt_jax.deploy.twin.network import Network
from bt_jax.deploy.twin.servo import SetpointFilter
from bt_jax.deploy.twin.settings import TIMING, Realism
from bt_jax.deploy.twin.simulated_gripper import GripperFault, SimulatedGripper
from bt_jax.deploy.twin.supervision import ContactSupervision

__all__ = ["CellModel", "SimulatedArm", "SimulatedRobot", "SimulationDiverged"]

MOTION_SUPERVISION = 50204  # the number of ABB's event


class SimulationDiverged(ArithmeticError):
    """Accelerations of the simulated cell are no longer numbers."""


@dataclasses.dataclass(frozen=True)
class CellModel:
    """A MuJoCo model with a robot's arms. Actuators are position servos: `actuators` of the joints in chain order [rad],
    `finger_actuators` of each finger [m]. `flanges` are sites whose poses the controller tells, in the world of the model,
    which is the robot's base frame."""

    xml: str
    assets: Mapping[str, bytes]
    qpos: Float[np.ndarray, " nq"]
    joints: Mapping[str, tuple[str, ...]]
    actuators: Mapping[str, tuple[str, ...]]
    finger_joints: Mapping[str, tuple[str, ...]]
    finger_actuators: Mapping[str, tuple[str, ...]]
    flanges: Mapping[str, str]
    grippers: Mapping[str, GripperModel]


class SimulatedArm:
    """One arm and its session."""

    def __init__(self, model: mujoco.MjModel, cell: CellModel, name: str, port: int, realism: Realism) -> None:
        self.name, self.gripper = name, cell.grippers[name]
        joints = [model.joint(joint).id for joint in cell.joints[name]]
        self.joint_ids = joints
        fingers = [model.joint(joint).id for joint in cell.finger_joints[name]]
        self.joints = model.jnt_qposadr[joints]
        self.fingers = model.jnt_qposadr[fingers]
        self.range = model.jnt_range[joints]
        self.actuators = np.array([model.actuator(a).id for a in cell.actuators[name]])
        self.finger_actuators = np.array([model.actuator(a).id for a in cell.finger_actuators[name]])
        self.flange = model.site(cell.flanges[name]).id
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.network = Network(self.socket, ("127.0.0.1", port))
        self.sequence = 0
        self.mci = Mci.STOPPED
        self.restart: float | None = None  # when the next session of EGM begins, s; None while one lasts
        self.silent = 0.0  # seconds since the last answer
        self.heard = False  # was there ever one?
        opening = 1000 * float(cell.qpos[self.fingers].mean())
        self.numbers = {
            GRIP_TARGET: opening,
            GRIP_FORCE: 10.0,
            EGM_REQUEST: float(Motion.LISTEN),
            EGM_STATE: float(Motion.LISTEN),
            EGM_HERE: 0.0,
        }  # of its RAPID program
        self.setpoints = SetpointFilter(realism, cell.qpos[self.joints])
        self.simulated_gripper = SimulatedGripper(realism, opening, self.numbers[GRIP_FORCE])


class SimulatedRobot:
    """The cell and its controller. Requests of other threads only set flags and numbers."""

    def __init__(self, cell: CellModel, ports: Mapping[str, int], realism: Realism) -> None:
        self.model = mujoco.MjModel.from_xml_string(cell.xml, dict(cell.assets))
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = cell.qpos
        mujoco.mj_forward(self.model, self.data)
        self.substeps = max(1, round(CYCLE / self.model.opt.timestep))
        self.model.opt.timestep = CYCLE / self.substeps
        self.arms = [SimulatedArm(self.model, cell, name, port, realism) for name, port in ports.items()]
        self.control, self.mode, self.cycle, self.unanswered = "motoron", "AUTO", 0, 0
        self.pushes: list[tuple[int, Float[np.ndarray, " 3"], float]] = []  # body, force, until
        for arm in self.arms:
            self.data.ctrl[arm.actuators] = self.data.qpos[arm.joints]
            self.data.ctrl[arm.finger_actuators] = self.data.qpos[arm.fingers]
            self.model.actuator_forcelimited[arm.finger_actuators] = True
        self.realism = realism
        self.supervision = ContactSupervision(self.model, {arm.name: arm.joint_ids for arm in self.arms})
        self.rapid = False  # the program of all arms
        self.messages: list[ControllerMessage] = []  # the controller's event log

    @property
    def time(self) -> float:
        """Seconds that were simulated."""
        return self.cycle * CYCLE

    def tell(self, kind: int, code: int, title: str) -> None:
        """Add a line to the event log: `kind` 1 for information, 2 for a warning, 3 for an error."""
        self.messages.append(ControllerMessage(len(self.messages) + 1, kind, code, title))

    def start_rapid(self) -> bool:
        if self.control != "motoron" or self.mode != "AUTO":
            return False
        if not self.rapid:
            for arm in self.arms:
                arm.numbers[EGM_REQUEST] = arm.numbers[EGM_STATE] = float(Motion.LISTEN)
                arm.numbers[EGM_HERE] = 0.0
                arm.mci = Mci.STOPPED
            self.rapid = True
        return True

    def stop_rapid(self, mci: Mci = Mci.STOPPED) -> None:
        self.rapid = False
        for arm in self.arms:
            arm.mci = mci
            arm.setpoints.brake()

    def number(self, url: str) -> float:
        arm, name = self._symbol(url)
        if name == GRIP_ACTUAL:
            return arm.simulated_gripper.reading
        return arm.numbers[name]

    def set_number(self, url: str, value: float) -> None:
        arm, name = self._symbol(url)
        if name not in arm.numbers:
            raise KeyError(url)
        arm.numbers[name] = value
        if name == EGM_REQUEST and self.rapid and arm.restart is None and arm.numbers[EGM_STATE] != value:
            arm.setpoints.brake()
            arm.mci, arm.restart = Mci.STOPPED, self.time + self.realism.egm_restart
            self._restart(arm)

    def _restart(self, arm: SimulatedArm) -> None:
        """Begin the session of EGM that was asked for, once its time has come."""
        if arm.restart is None or self.time < arm.restart - 1e-6:
            return
        arm.restart, arm.silent = None, 0.0
        if self.realism.egm_restart > 0:
            arm.sequence = 0
        if self.rapid:
            arm.numbers[EGM_STATE] = arm.numbers[EGM_REQUEST]
            arm.mci = Mci.RUNNING if arm.numbers[EGM_STATE] == Motion.GUIDED else Mci.STOPPED

    def _symbol(self, url: str) -> tuple[SimulatedArm, str]:
        name = url.rsplit("/", 1)[-1]
        for arm in self.arms:
            if name in (*arm.numbers, GRIP_ACTUAL) and url == symbol(arm.name, name):
                return arm, name
        raise KeyError(url)

    def speak(self) -> None:
        """Send the feedback of all arms."""
        on = self.control == "motoron"
        for arm in self.arms:
            if arm.restart is not None:
                continue
            arm.sequence += 1
            message = Feedback(
                arm.sequence,
                self.time,
                self.data.qpos[arm.joints],
                self.data.ctrl[arm.actuators],
                on,
                arm.mci,
                self.rapid,
                self._flange(arm),
            )
            arm.network.send(message.encode(), self.time)

    def _flange(self, arm: SimulatedArm) -> PoseRow:
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, self.data.site_xmat[arm.flange])
        return np.concatenate([self.data.site_xpos[arm.flange], quaternion])

    def listen(self, arm: SimulatedArm, patience: float) -> None:
        """Take what was answered; for at most `patience` seconds wait for the answer to the last message. A client need not
        repeat the time that it answers."""
        newest: Setpoint | None = None
        deadline = time.monotonic() + patience
        while True:
            for data in arm.network.receive(self.time):
                try:
                    setpoint = Setpoint.decode(data, len(arm.joints))
                except ValueError:
                    continue
                if newest is None or setpoint.sequence > newest.sequence:
                    newest = setpoint
            left = deadline - time.monotonic()
            if left <= 0 or (newest is not None and (newest.time == 0 or newest.time > self.time - CYCLE / 2)):
                break
            select.select([arm.socket], [], [], left)
        if newest is None:
            self.unanswered += arm.mci == Mci.RUNNING
            return
        arm.silent, arm.heard = 0.0, True
        if arm.mci == Mci.RUNNING and self.control == "motoron":
            low, high = arm.range.T
            if np.all((newest.joints >= low) & (newest.joints <= high)):
                arm.setpoints.take(newest.joints, self.time)
            else:
                self.tell(3, 50027, "Joint Out of Range")
                self.stop_rapid(Mci.ERROR)  # as a real controller does with a target out of range

    def step(self) -> None:
        """Simulate one cycle of physics, grippers and supervision."""
        for arm in self.arms:
            self._restart(arm)
            if arm.mci == Mci.RUNNING:
                arm.silent += CYCLE
                if arm.silent > TIMING.silence:
                    self.stop_rapid(Mci.ERROR)
            self.data.ctrl[arm.actuators] = arm.setpoints.advance(self.time)
            self._move_fingers(arm)
        self.data.xfrc_applied[:] = 0
        self.pushes = [push for push in self.pushes if push[2] > self.time]
        for body, force, _ in self.pushes:
            self.data.xfrc_applied[body, :3] += force
        mujoco.mj_step(self.model, self.data, self.substeps)
        if self.data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise SimulationDiverged("the simulation diverged")
        self.cycle += 1
        self._supervise()

    def _move_fingers(self, arm: SimulatedArm) -> None:
        if self.rapid:
            arm.simulated_gripper.serve(
                self.time,
                target=float(np.clip(arm.numbers[GRIP_TARGET], 0, 1000 * arm.gripper.stroke)),
                force=arm.numbers[GRIP_FORCE],
                position=1000 * float(self.data.qpos[arm.fingers].mean()),
            )
        grip = arm.simulated_gripper.advance(self.time)
        reach = self.realism.finger_speed * CYCLE
        ctrl = self.data.ctrl[arm.finger_actuators]
        self.data.ctrl[arm.finger_actuators] = ctrl + np.clip(grip.target / 1000 - ctrl, -reach, reach)
        force = np.clip(grip.force, 0, arm.gripper.force)
        self.model.actuator_forcerange[arm.finger_actuators] = (-force, force)

    def _supervise(self) -> None:
        """Stop the arms where something presses on one, which backs off, as a controller does."""
        if not self.rapid or self.realism.contact == math.inf:
            return
        forces = self.supervision.advance(self.data)
        pressed = [arm for arm, force in forces.items() if force > self.realism.contact]
        if not pressed:
            return
        for name in pressed:
            self.tell(3, MOTION_SUPERVISION, f"Motion supervision of the {name} arm")
        self.stop_rapid(Mci.ERROR)
        self.supervision.reset()
        for arm in self.arms:
            joints = self.data.qpos[arm.joints]
            ahead = self.data.ctrl[arm.actuators] - joints  # what drives it against what it has met
            arm.setpoints.begin(joints - ahead if arm.name in pressed else joints)

    def put(self, body: str, pose: PoseRow) -> None:
        place = self.model.body(body).mocapid[0]
        if place >= 0:
            self.data.mocap_pos[place], self.data.mocap_quat[place] = pose[:3], pose[3:]
            return
        joint = self.model.body(body).jntadr[0]
        if joint < 0 or self.model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
            raise ValueError(f"{body} cannot be moved by hand")
        at, speed = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        self.data.qpos[at : at + 7] = pose
        self.data.qvel[speed : speed + 6] = 0

    def gripper_fault(self, fault: GripperFault) -> None:
        for arm in self.arms:
            arm.simulated_gripper.fault = fault

    def fault(self, kind: str, details: Mapping[str, float]) -> None:
        if kind in ("motors_off", "emergency_stop"):
            self.control = {"motors_off": "motoroff", "emergency_stop": "emergencystop"}[kind]
            self.tell(*{"motors_off": (1, 10011, "Motors OFF"), "emergency_stop": (3, 10013, "Emergency stop")}[kind])
            self.stop_rapid()
            return
        for arm in self.arms:
            arm.network.fault(kind, self.time, **details)
