"""What is checked before a robot may move. Each item passes with what was found, or fails with the remedy.

Every limit is written as `not (value <= limit)`, here and wherever something may move the robot: NaN fails.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from rich.console import Console
from rich.markup import escape
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Kind, expand
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.observer import Perceiving
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import CalibrationLimits
from bt_jax.deploy.execution.statuses import Context, Statuses
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.link.realtime import may_take_priority
from bt_jax.deploy.link.reception import Reception, complaint
from bt_jax.deploy.link.rws import ControllerState
from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.link.settings import LinkConfig
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix

__all__ = ["CheckResult", "CheckedLink", "Equipment", "passed", "preflight", "show"]

LISTEN = 2.0  # seconds for which feedback and camera are watched
FLANGE = (
    0.005  # metres between the controller's pose of the flange and ours: a calibrated arm differs from the nominal one
)
TURN = np.radians(1.0)
CALIBRATION = CalibrationLimits()
IMAGE = 0.5  # seconds that the newest image may be old


@dataclasses.dataclass(frozen=True)
class CheckResult:
    """One item. `passed` is None where another item must pass first."""

    name: str
    passed: bool | None
    detail: str


@runtime_checkable
class CheckedLink(RobotLink, Protocol):
    """What is asked of a link before anything moves."""

    config: LinkConfig
    rules: Rules

    def reception(self, arm: str) -> Reception:
        """Return what came to the port of an arm so far."""

    def elsewhere(self) -> dict[int, str]:
        """Return the ports, other than ours, to which something comes, with the address of its sender."""

    def state(self) -> ControllerState:
        """Return the controller's state, asked for now."""


@dataclasses.dataclass(frozen=True)
class Equipment:
    """What is to be checked; absent parts make their items fail."""

    program: Program
    link: CheckedLink
    flange: Callable[[str, Joints], RigidTransform]  # our forward kinematics: arm, joints -> tool0 in the base
    perception: Perceiving | None
    intrinsics_error: float | None  # pixels
    camera_residual: float | None  # metres
    reachable: Callable[[str, Observation], bool]
    twin_log: Path | None
    may_take_priority: Callable[[], bool] = may_take_priority  # on this computer


def preflight(equipment: Equipment) -> Iterator[CheckResult]:
    """Check everything, one after the other. Nothing moves."""
    looks: list[tuple[str, str | None, Callable[[Equipment], str]]] = [
        ("tree: every leaf is known", None, _leaves),
        ("twin: this tree ran there", None, _twin),
        ("computer: real-time priority", None, _priority),
        ("controller: state", None, _state),
        ("link: feedback of both arms", "controller: state", _feedback),
        ("arms: joints within limits", "link: feedback of both arms", _limits),
        ("arms: feedback equals kinematics", "link: feedback of both arms", _kinematics),
        ("grippers: position", "controller: state", _grippers),
        ("camera: intrinsics", None, _intrinsics),
        ("camera: pose in the base frame", None, _hand_eye),
        ("camera: images", None, _images),
        ("markers: everything is seen", "camera: images", _markers),
        ("arms: every box is within reach", "markers: everything is seen", _reach),
    ]
    failed: set[str] = set()
    for name, needs, look in looks:
        if needs in failed:
            failed.add(name)
            yield CheckResult(name, None, f"needs '{needs}'")
            continue
        try:
            yield CheckResult(name, True, look(equipment))
        except Exception as problem:  # a look must never end the others
            failed.add(name)
            text = str(problem) if isinstance(problem, UserError) else f"{type(problem).__name__}: {problem}"
            yield CheckResult(name, False, text)


def passed(items: list[CheckResult]) -> bool:
    """Has every item passed?"""
    return all(item.passed for item in items)


def show(console: Console, item: CheckResult) -> None:
    """Print one item."""
    mark = {True: "[green]✓[/]", False: "[bold red]✗[/]", None: "[dim]-[/]"}[item.passed]
    console.print(f"{mark} {item.name:36s} {escape(item.detail)}")


def _leaves(equipment: Equipment) -> str:
    task = equipment.program.task
    nothing = Observation(0.0, {}, dict.fromkeys(equipment.link.arms, 0.0), None)
    leaves = [node for node in prefix(expand(equipment.program.tree)) if isinstance(node, Behavior)]
    for leaf in leaves:
        try:
            status = Statuses(task, nothing, Context())(leaf, 0)
        except (ValueError, KeyError) as problem:
            raise UserError(f"{leaf} means nothing to the executor ({problem}); use another tree") from problem
        if leaf.kind == Kind.CONDITION and leaf.name in ("at", "reachable", "clear") and status == Status.SUCCESS:
            raise UserError(f"{leaf} holds with nothing seen; do not run this version on a robot")
    return f"{len(leaves)} leaves, tree {equipment.program.digest[:12]}"


def _twin(equipment: Equipment) -> str:
    if equipment.twin_log is None:
        raise UserError(
            "no log of the twin was given; run python -m bt_jax.deploy twin and give its log with --twin-log"
        )
    entries = list(read_log(equipment.twin_log))
    start, end = entries[0], entries[-1]
    if start.get("settings", {}).get("robot") != "twin":
        raise UserError(f"{equipment.twin_log} is not of the twin; run this tree there and give the log of that")
    if start.get("digest") != equipment.program.digest:
        raise UserError(f"{equipment.twin_log} is of another tree; run this one in the twin")
    if start.get("task") != equipment.program.task.to_dict():
        raise UserError(f"{equipment.twin_log} is of another task; run this one in the twin")
    if end["kind"] != "end" or end["exit_code"] != 0 or start.get("dry") is not False:
        raise UserError(f"the run in {equipment.twin_log} did not succeed; look into it with replay and fix the tree")
    return f"succeeded in {end.get('seconds', np.nan):.0f} s, {end.get('ticks')} ticks"


def _priority(equipment: Equipment) -> str:
    if not equipment.may_take_priority():
        raise UserError(
            "this user may not ask for real-time priority; add 'rtprio 50' for them in /etc/security/limits.conf"
        )
    return "may be asked for"


def _state(equipment: Equipment) -> str:
    state = equipment.link.state()
    if not state.ready:
        raise UserError(
            f"the controller is in {state.control}, mode {state.mode}; put it in automatic mode with motors on"
        )
    return f"{state.control}, {state.mode}, RAPID {state.rapid}"


def _feedback(equipment: Equipment) -> str:
    link = equipment.link
    before = {arm: link.reception(arm) for arm in link.arms}
    counted, began = link.counters(), link.now()
    while link.now() < began + LISTEN:
        link.wait(link.now() + 0.1)
    seconds = link.now() - began
    for arm in link.arms:
        port, after = link.config.ports[arm], link.reception(arm)
        if after.since(before[arm]).silent:
            raise UserError(_silence(link, arm, port))
        problem = complaint(arm, port, link.config.host, before[arm], after, seconds)
        if problem is not None:
            raise UserError(problem)
    now = link.counters()
    got, lost, late = now.cycles - counted.cycles, now.lost - counted.lost, now.late - counted.late
    return f"{got} messages in {seconds:.1f} s, {lost} lost, {late} late"


def _silence(link: CheckedLink, arm: str, port: int) -> str:
    """Say what to do where nothing comes to an arm's port; where something comes to another one, that."""
    elsewhere = link.elsewhere()
    if elsewhere:
        ports = ", ".join(f"{other} (from {sender})" for other, sender in sorted(elsewhere.items()))
        return (
            f"nothing came to UDP port {port} for the {arm} arm, but messages come to {ports}; name the ports with --ports, "
            "left arm first"
        )
    return (
        f"nothing came from the {arm} arm; load BtJax (python -m bt_jax.deploy rapid), choose PP to main and start it, with "
        f"its EGM set up to send to UDP port {port} of this machine, which a firewall must let in"
    )


def _limits(equipment: Equipment) -> str:
    rules, closest = equipment.link.rules, np.inf
    for arm in equipment.link.arms:
        joints = equipment.link.arm(arm).joints
        room = float(np.min(np.minimum(joints - rules.lower, np.array(rules.upper) - joints)))
        if not room >= rules.margin:
            raise UserError(
                f"a joint of the {arm} arm is {np.degrees(room):.1f} deg from its limit; jog it to the middle"
            )
        closest = min(closest, room)
    return f"{np.degrees(closest):.0f} deg from the nearest limit"


def _kinematics(equipment: Equipment) -> str:
    worst = 0.0
    for arm in equipment.link.arms:
        state = equipment.link.arm(arm)
        if state.flange is None:
            raise UserError(
                f"the {arm} arm's EGM tells no Cartesian pose; use quaternions, tool0 and wobj0 in its setup"
            )
        change = equipment.flange(arm, state.joints).inv() * state.flange
        away, turn = float(np.linalg.norm(change.translation)), change.rotation.magnitude()
        if not (away <= FLANGE and turn <= TURN):
            raise UserError(
                f"the {arm} arm's flange is {1000 * away:.1f} mm and {np.degrees(turn):.1f} deg from where its joints put "
                "it; check axis order, tool0, wobj0 and the base frames"
            )
        worst = max(worst, away)
    return f"{1000 * worst:.2f} mm at most"


def _grippers(equipment: Equipment) -> str:
    openings = {arm: equipment.link.arm(arm).opening for arm in equipment.link.arms}
    widest = equipment.program.task.gripper_opening
    for arm, opening in openings.items():
        if not -0.001 <= opening <= widest + 0.001:
            raise UserError(f"the {arm} gripper tells {1000 * opening:.1f} mm; calibrate it on the pendant")
    return ", ".join(f"{arm} {1000 * opening:.1f} mm" for arm, opening in openings.items())


def _intrinsics(equipment: Equipment) -> str:
    error = equipment.intrinsics_error
    if error is None:
        raise UserError("the camera is not calibrated; run python -m bt_jax.deploy calibrate")
    if not error <= CALIBRATION.reprojection:
        raise UserError(f"the calibration is off by {error:.2f} pixels; repeat it with sharper pictures")
    return f"reprojection error {error:.2f} pixels"


def _hand_eye(equipment: Equipment) -> str:
    residual = equipment.camera_residual
    if residual is None:
        raise UserError("where the camera stands is not known; run python -m bt_jax.deploy calibrate")
    if not residual <= CALIBRATION.residual:
        raise UserError(f"camera and robot disagree by {1000 * residual:.1f} mm; repeat the calibration")
    return f"residual {1000 * residual:.1f} mm"


def _images(equipment: Equipment) -> str:
    if equipment.perception is None:
        raise UserError("no camera was given; give one with --camera")
    times, link = set(), equipment.link
    began = link.now()
    while link.now() < began + LISTEN:
        equipment.perception.update()
        times.add(equipment.perception.image)
        link.wait(link.now() + 0.05)
    age = link.now() - max(times)
    if not (age <= IMAGE and len(times) >= 4):
        why = f" ({equipment.perception.lost})" if equipment.perception.lost else ""
        raise UserError(f"{len(times)} images in {LISTEN:g} s, the last {age:.2f} s old{why}; check the camera's cable")
    return f"{len(times)} images in {LISTEN:g} s"


def _markers(equipment: Equipment) -> str:
    task = equipment.program.task
    poses = {} if equipment.perception is None else equipment.perception.poses(equipment.link.now())
    missing = [name for name in (*task.box_names, task.kit.name) if name not in poses]
    if missing:
        raise UserError(f"{', '.join(missing)} cannot be seen; put it in view, with its markers uncovered")
    return f"{len(poses)} objects"


def _reach(equipment: Equipment) -> str:
    task, now = equipment.program.task, equipment.link.now()
    openings = {arm: equipment.link.arm(arm).opening for arm in equipment.link.arms}
    poses = {} if equipment.perception is None else equipment.perception.poses(now)
    seen = Observation(now, poses, openings, None)
    away = [name for name in task.box_names if not equipment.reachable(name, seen)]
    if away:
        raise UserError(f"no arm can grasp {', '.join(away)}; move it nearer to the robot's middle")
    return ", ".join(task.box_names)
