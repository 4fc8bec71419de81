"""What can be checked before a robot with nothing but this computer: tree, twin, payload, rest, ports.

Each check returns what was found, or raises UserError with the remedy.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Kind, expand
from bt_jax.deploy.execution.equipment import Equipment, opened
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.statuses import Context, Statuses
from bt_jax.deploy.link.reception import open_socket
from bt_jax.deploy.link.safety import Rejected, check_setpoint
from bt_jax.deploy.planning.feasibility import load_share
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import task_from_dict

__all__ = ["home_clear", "leaves_known", "payload_allowed", "ports_free", "priority_allowed", "ran_in_twin"]

FIREWALLS = {  # file that tells whether it is on -> line in it, its name, and how it lets a port in
    "/etc/ufw/ufw.conf": ("ENABLED=yes", "ufw", "sudo ufw allow {port}/udp"),
    "/etc/firewalld/firewalld.conf": ("", "firewalld", "sudo firewall-cmd --add-port={port}/udp"),
}


def leaves_known(equipment: Equipment) -> str:
    """Every leaf of the tree means something to the executor, and none holds with nothing seen."""
    program = opened(equipment.program)
    task = program.task
    nothing = Observation(0.0, {}, dict.fromkeys(equipment.robot.arm_names, 0.0), None)
    leaves = [node for node in prefix(expand(program.tree)) if isinstance(node, Behavior)]
    for leaf in leaves:
        try:
            status = Statuses(task, nothing, Context())(leaf, 0)
        except (ValueError, KeyError) as problem:
            raise UserError(f"{leaf} means nothing to the executor ({problem}); use another tree") from problem
        if leaf.kind == Kind.CONDITION and leaf.name in ("at", "reachable", "clear") and status == Status.SUCCESS:
            raise UserError(f"{leaf} holds with nothing seen; do not run this version on a robot")
    return f"{len(leaves)} leaves, tree {program.digest[:12]}"


def ran_in_twin(equipment: Equipment) -> str:
    """The same tree succeeded in the twin, for the same task."""
    program = opened(equipment.program)
    if equipment.twin_log is None:
        raise UserError(
            "no log of the twin was given; run python -m bt_jax.deploy twin and give its log with --twin-log"
        )
    entries = list(read_log(equipment.twin_log))
    start, end = entries[0], entries[-1]
    if start.get("settings", {}).get("robot") != "twin":
        raise UserError(f"{equipment.twin_log} is not of the twin; run this tree there and give the log of that")
    if start.get("digest") != program.digest:
        raise UserError(f"{equipment.twin_log} is of another tree; run this one in the twin")
    if task_from_dict(start.get("task"), source=str(equipment.twin_log), kept=True) != program.task:
        raise UserError(f"{equipment.twin_log} is of another task; run this one in the twin")
    if end["kind"] != "end" or end["exit_code"] != 0 or start.get("dry") is not False:
        raise UserError(f"the run in {equipment.twin_log} did not succeed; look into it with replay and fix the tree")
    return f"succeeded in {end.get('seconds', np.nan):.0f} s, {end.get('ticks')} ticks"


def priority_allowed(equipment: Equipment) -> str:
    """This user may take real-time priority."""
    if not equipment.may_take_priority():
        raise UserError(
            "this user may not ask for real-time priority; add 'rtprio 50' for them in /etc/security/limits.conf"
        )
    return "may be asked for"


def payload_allowed(equipment: Equipment) -> str:
    """No arm has to carry more than it may, with its gripper."""
    share = load_share(equipment.robot, opened(equipment.program).task, equipment.gripper_mass)
    return f"{100 * share:.0f} % of what an arm may carry"


def home_clear(equipment: Equipment) -> str:
    """The arms may rest at home: within their limits, clear of each other and of the task's tables."""
    rules, home = opened(equipment.rules), equipment.robot.home
    try:
        for arm, joints in home.items():
            check_setpoint(rules, arm, joints)
    except Rejected as broken:
        raise UserError(f"the arms may not rest at home ({broken}); change the tables of the task") from broken
    if rules.clearance_of is None:
        return "within limits"
    distance = rules.clearance_of()(home)
    if not distance >= rules.clearance:
        raise UserError(
            f"at home the arms are {1000 * distance:.0f} mm from each other or from a table; change the tables of the task"
        )
    return f"{1000 * distance:.0f} mm clear"


def ports_free(equipment: Equipment) -> str:
    """The ports for the arms' messages can be used; and a firewall that may keep messages out is named."""
    ports = tuple(equipment.config.ports.values())
    if isinstance(equipment.link, UserError):
        for port in ports:
            try:
                open_socket(port).close()
            except OSError as error:
                raise UserError(
                    f"UDP port {port} cannot be used ({error.strerror or error}); end the program that uses it, or name "
                    "other ports with --ports"
                ) from error
    hints = [hint for port in ports if (hint := _firewall(port))]
    return ", ".join(map(str, ports)) + (f"; {'; '.join(hints)}" if hints else "")


def _firewall(port: int) -> str:
    """Return how to let a port in where a firewall seems to be on, "" if none is known."""
    for path, (line, name, command) in FIREWALLS.items():
        with contextlib.suppress(OSError, ValueError):
            if line in Path(path).read_text(encoding="utf-8").splitlines() or not line:
                return f"{name} may keep messages out: {command.format(port=port)}"
    return ""
