"""What is checked before a robot may move. Each item passes with what was found, or fails with the remedy.

Every limit is written as `not (value <= limit)`, here and wherever something may move the robot: NaN fails. So does what is
negative and cannot be: `not 0 <= value <= limit`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Container, Iterator

import numpy as np
from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.equipment import CheckedLink, Equipment, opened
from bt_jax.deploy.execution.line_of_sight import LineOfSight
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.offline_checks import (
    home_clear,
    leaves_known,
    payload_allowed,
    ports_free,
    priority_allowed,
    ran_in_twin,
)
from bt_jax.deploy.execution.settings import CalibrationLimits, GraspSettings
from bt_jax.deploy.link.reception import complaint, title
from bt_jax.deploy.robot.arrays import Joints

__all__ = ["ARMS_HELD", "CAMERA", "CONTROLLER", "CheckResult", "passed", "preflight", "show"]

TREE, IMAGES, MARKERS = "tree: every leaf is known", "camera: images", "markers: everything is seen"  # needed by others
CONTROLLER, FEEDBACK = "controller: state", "link: feedback of all arms"
LIMITS, KINEMATICS = "arms: joints within limits", "arms: feedback equals kinematics"
INTRINSICS, PLACE = "camera: intrinsics", "camera: pose in the base frame"
PLAUSIBLE, FINDINGS = "arms: joints are possible", "camera: nothing is wrong in sight"
CAMERA = (INTRINSICS, PLACE, IMAGES)  # before a recovery with a camera
ARMS_HELD = (FEEDBACK, PLAUSIBLE, KINEMATICS, FINDINGS)  # once a recovery holds the arms, before they move

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


def preflight(equipment: Equipment, only: Container[str] | None = None) -> Iterator[CheckResult]:
    """Check everything, or `only` some items, one after the other. Nothing moves."""
    looks: list[tuple[str, tuple[str, ...], Callable[[Equipment], str]]] = [
        (TREE, (), leaves_known),
        ("twin: this tree ran there", (TREE,), ran_in_twin),
        ("payload: boxes and gripper", (TREE,), payload_allowed),
        ("arms: home is clear", (TREE,), home_clear),
        ("computer: real-time priority", (), priority_allowed),
        ("computer: UDP ports", (), ports_free),
        (CONTROLLER, (), _state),
        (FEEDBACK, (), _feedback),
        (LIMITS, (FEEDBACK,), _limits),
        (KINEMATICS, (FEEDBACK,), _kinematics),
        ("grippers: position", (CONTROLLER, FEEDBACK), _grippers),
        (INTRINSICS, (), _intrinsics),
        (PLACE, (), _hand_eye),
        (IMAGES, (TREE,), _images),
        (FINDINGS, (TREE, IMAGES), _findings),
        (MARKERS, (TREE, IMAGES), _markers),
        ("arms: every box is within reach", (MARKERS,), _reach),
    ]
    if only is not None:
        looks.insert(0, (PLAUSIBLE, (), _plausible))
        looks = [look for look in looks if look[0] in only]
    failed: set[str] = set()
    for name, needs, look in looks:
        missing = [need for need in needs if need in failed]
        if name == FEEDBACK and isinstance(equipment.link, UserError):
            missing = [CONTROLLER]
        if missing:
            failed.add(name)
            yield CheckResult(name, None, f"needs '{missing[0]}'")
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


def _state(equipment: Equipment) -> str:
    state = opened(equipment.link).state()
    if not state.ready:
        raise UserError(
            f"the controller is in {state.control}, mode {state.mode}; put it in automatic mode with motors on"
        )
    return f"{state.control}, {state.mode}, RAPID {state.rapid}"


def _feedback(equipment: Equipment) -> str:
    link = opened(equipment.link)
    before = {arm: link.reception(arm) for arm in link.arms}
    counted, began = link.counters(), link.now()
    while link.now() < began + LISTEN:
        link.wait(link.now() + 0.1)
    seconds = link.now() - began
    for arm in link.arms:
        port, after = link.config.ports[arm], link.reception(arm)
        if after.since(before[arm]).silent:
            raise UserError(_silence(link, arm, port))
        problem = complaint(
            arm, port, link.config.host, before[arm], after, seconds, axes=len(equipment.robot.arm(arm).joints)
        )
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
            f"nothing came to UDP port {port} for {title(arm)}, but messages come to {ports}; name the ports with --ports, "
            "left arm first"
        )
    return (
        f"nothing came from {title(arm)}; load BtJax (python -m bt_jax.deploy rapid), choose PP to main and start it, with "
        f"its EGM set up to send to UDP port {port} of this machine, which a firewall must let in"
    )


def _joints(link: CheckedLink, arm: str) -> Joints:
    """Return an arm's joints [rad]. Raise UserError where not all of them are finite."""
    joints = link.arm(arm).joints
    if not np.all(np.isfinite(joints)):
        raise UserError(f"{title(arm)} tells joints that are not finite ({joints}); restart its controller")
    return joints


def _limits(equipment: Equipment) -> str:
    link, closest = opened(equipment.link), np.inf
    rules = link.rules
    for arm in link.arms:
        joints = _joints(link, arm)
        room = float(np.min(np.minimum(joints - rules.lower, np.array(rules.upper) - joints)))
        if not room >= rules.margin:
            raise UserError(
                f"a joint of {title(arm)} is {np.degrees(room):.1f} deg from its limit; jog it to the middle"
            )
        closest = min(closest, room)
    return f"{np.degrees(closest):.0f} deg from the nearest limit"


def _plausible(equipment: Equipment) -> str:
    """Look whether the arms may be where they say: a stop may have left one nearer to its limits than a run may begin."""
    link = opened(equipment.link)
    room = link.rules.implausible
    for arm in link.arms:
        joints = link.arm(arm).joints
        beyond = float(np.max(np.maximum(link.rules.lower - joints, joints - link.rules.upper)))
        if not beyond <= room:
            raise UserError(
                f"a joint of the {arm} arm is {np.degrees(beyond):.1f} deg beyond its limit; check axis order"
            )
    return f"{np.degrees(room):.0f} deg beyond the limits at most"


def _kinematics(equipment: Equipment) -> str:
    link, worst = opened(equipment.link), 0.0
    for arm in link.arms:
        state, joints = link.arm(arm), _joints(link, arm)
        if state.flange is None:
            raise UserError(
                f"the EGM of {title(arm)} tells no Cartesian pose; use quaternions, tool0 and wobj0 in its setup"
            )
        change = equipment.flange(arm, joints).inv() * state.flange
        away, turn = float(np.linalg.norm(change.translation)), change.rotation.magnitude()
        if not (away <= FLANGE and turn <= TURN):
            raise UserError(
                f"the flange of {title(arm)} is {1000 * away:.1f} mm and {np.degrees(turn):.1f} deg from where its joints "
                "put it; check axis order, tool0, wobj0 and the base frames"
            )
        worst = max(worst, away)
    return f"{1000 * worst:.2f} mm at most"


def _grippers(equipment: Equipment) -> str:
    link = opened(equipment.link)
    openings = {arm: link.arm(arm).opening for arm in link.arms}
    for arm, opening in openings.items():
        if not -0.001 <= opening <= equipment.robot.arm(arm).gripper.opening + 0.001:
            raise UserError(f"the gripper of {title(arm)} tells {1000 * opening:.1f} mm; calibrate it on the pendant")
    return ", ".join(f"{arm} {1000 * opening:.1f} mm" for arm, opening in openings.items())


def _intrinsics(equipment: Equipment) -> str:
    error = opened(
        equipment.intrinsics_error, "the camera is not calibrated; run python -m bt_jax.deploy calibrate intrinsics"
    )
    if not 0 <= error <= CALIBRATION.reprojection:
        raise UserError(f"the calibration is off by {error:.2f} pixels; repeat it with sharper pictures")
    return f"reprojection error {error:.2f} pixels"


def _hand_eye(equipment: Equipment) -> str:
    residual = opened(
        equipment.camera_residual, "where the camera stands is not known; run python -m bt_jax.deploy calibrate base"
    )
    if not 0 <= residual <= CALIBRATION.residual:
        raise UserError(f"camera and robot disagree by {1000 * residual:.1f} mm; repeat the calibration")
    return f"residual {1000 * residual:.1f} mm"


def _images(equipment: Equipment) -> str:
    perception = opened(equipment.perception, "no camera was given; give one with --camera, and its --calibration")
    times, began = set(), equipment.now()
    while equipment.now() < began + LISTEN:
        perception.update()
        times.add(perception.image)
        equipment.wait(0.05)
    age = equipment.now() - float(np.max(list(times)))  # of NaN too, which is no largest for `max`
    if not (abs(age) <= IMAGE and len(times) >= 4):
        why = f" ({perception.lost})" if perception.lost else ""
        raise UserError(f"{len(times)} images in {LISTEN:g} s, the last {age:.2f} s old{why}; check the camera's cable")
    return f"{len(times)} images in {LISTEN:g} s"


def _findings(equipment: Equipment) -> str:
    found = opened(equipment.perception).findings(equipment.now())
    if not isinstance(equipment.link, UserError):
        joints = {arm: equipment.link.arm(arm).joints for arm in equipment.link.arms}
        if all(np.isfinite(each).all() for each in joints.values()):
            arms = LineOfSight(equipment.robot, opened(equipment.program).task)
            found = tuple(f for f in found if not (f.sight and arms.blocked(joints, f.sight, GraspSettings.before)))
    if found:
        raise UserError("; ".join(map(str, found)))
    return "sharp, markers once, heights as they must be"


def _markers(equipment: Equipment) -> str:
    task = opened(equipment.program).task
    poses = opened(equipment.perception).poses(equipment.now())
    missing = [name for name in (*task.object_names, *task.kit_names) if name not in poses]
    if missing:
        raise UserError(f"{', '.join(missing)} cannot be seen; put it in view, with its markers uncovered")
    return f"{len(poses)} objects"


def _reach(equipment: Equipment) -> str:
    task, now = opened(equipment.program).task, equipment.now()
    openings = {arm.name: arm.gripper.opening for arm in equipment.robot.arms}
    seen = Observation(now, opened(equipment.perception).poses(now), openings, None)
    away = [name for name in task.object_names if not equipment.reachable(name, seen)]
    if away:
        raise UserError(f"no arm can grasp {', '.join(away)}; move it nearer to the robot's middle")
    return ", ".join(task.object_names)
