"""Demonstrations from a script of what the person at the gripper does, in simulation.

Steps are separated by semicolons or lines: `pick OBJECT; move (DX, DY, DZ); turn DEGREES; to (X, Y, Z) FRAME [DEGREES];
to SLOT; release`. Positions are those of the centre of the object, in metres. Degrees are about the vertical: those of
`turn` count from how it is held, those of `to` in the frame. Of a part, such as Bolt, the nearest instance is picked that
was not moved before. The rest of a line after # is a comment.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree, Vocabulary
from bt_jax.behaviors.notation import plain
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import Demonstration
from bt_jax.lfd.clustering import NEEDED
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.teaching.teleoperation import Teleoperation

__all__ = ["Input", "parse_script", "perform", "reached_by", "record", "record_one"]

DEMONSTRATED = 1 << 21  # seeds of layouts for demonstrations; neither training nor tests use them
_INPUT = re.compile(
    r"(?P<pick>pick)\s+(?P<object>\w+)|(?P<move>move)\s*\((?P<by>[^()]*)\)|(?P<turn>turn)\s+(?P<degrees>[^\s()]+)"
    r"|(?P<to>to)\s*\((?P<at>[^()]*)\)\s*(?P<frame>\w+)(\s+(?P<turned>[^\s()]+))?"
    r"|to\s+(?P<slot>\w+\.\w+)|(?P<release>release)"
)


@dataclasses.dataclass(frozen=True)
class Input:
    """One thing that the person does; `position` is a vector in metres, `turn` degrees."""

    kind: str
    name: str = ""  # of the object for pick, of the frame for to, of the slot for slot
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    turn: float | None = None


def parse_script(text: str) -> list[Input]:
    """Read a script. Raise UserError, naming the step, if it is invalid."""
    lines = (line.partition("#")[0] for line in plain(text).splitlines())
    steps = [" ".join(step.split()) for line in lines for step in line.split(";") if step.strip()]
    found = []
    for step in steps:
        match = _INPUT.fullmatch(step)
        if match is None:
            raise UserError(
                f"'{step}' is not a step; write pick OBJECT, move (X, Y, Z), turn DEGREES, to (X, Y, Z) FRAME, to SLOT, "
                "or release"
            )
        if match["pick"]:
            found.append(Input("pick", match["object"]))
        elif match["release"]:
            found.append(Input("release"))
        elif match["slot"]:
            found.append(Input("slot", match["slot"]))
        elif match["turn"]:
            found.append(Input("turn", turn=_degrees(match["degrees"], step)))
        elif match["to"]:
            turn = None if match["turned"] is None else _degrees(match["turned"], step)
            found.append(Input("to", match["frame"], _vector(match["at"], step), turn))
        else:
            found.append(Input("move", "", _vector(match["by"], step)))
    if not found:
        raise UserError("the script is empty; write for instance pick BlueBox; to (0, 0, 0.12) GreenBox; release")
    return found


def _vector(text: str, step: str) -> tuple[float, ...]:
    try:
        values = tuple(float(x) for x in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3 or not np.all(np.isfinite(values)):
        raise UserError(f"'{step}': ({text}) is not three numbers; write metres, as (0, 0, 0.12)")
    return values


def _degrees(text: str, step: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UserError(f"'{step}': {text} is not a number of degrees; write one, such as 90")
    return value


def perform(
    session: Teleoperation, script: Sequence[Input], *, noise: float = 0.0, rng: np.random.Generator | None = None
) -> Demonstration:
    """Do what a script says in a session, missing each place by Gaussian `noise` [m], and return the recording. A hand that
    comes down too low is stopped by what is there."""
    off = np.zeros(3)
    for step in script:
        missed = off
        off = rng.normal(0.0, noise, 3) if rng is not None and noise else np.zeros(3)
        match step.kind:
            case "pick":
                session.pick(step.name)
            case "move":
                session.move(np.array(step.position) + off)
            case "to":
                session.move_to(np.array(step.position) + off, step.name)
                if step.turn is not None:
                    session.turn_to(step.turn, step.name)
            case "slot":
                session.move_to_slot(step.name, off=off)
            case "turn":
                session.turn_by(step.turn or 0.0)
            case "release":
                if missed[2] < 0 and session.held and session.landing().inside is not None:
                    session.move((0.0, 0.0, -missed[2]))
                session.release()
    return session.demonstration()


def record(
    task: Task,
    physics: Physics,
    script: Sequence[Input],
    *,
    count: int = NEEDED,
    seed: int = 0,
    noise: float = 0.0,
    after: Tree | None = None,
) -> list[Demonstration]:
    """Return demonstrations of one script in `count` layouts, numbered from `seed`; the tree `after` is executed first
    in each. Raise UserError, naming the layout, if the script does not work in one."""
    return [record_one(task, physics, script, number, noise=noise, after=after) for number in range(seed, seed + count)]


def record_one(
    task: Task, physics: Physics, script: Sequence[Input], number: int, *, noise: float = 0.0, after: Tree | None = None
) -> Demonstration:
    """Return the demonstration in one layout, as `record` does. Raise UserError, naming the layout, if the script does not
    work there."""
    start, rng = sample_layouts(task, [DEMONSTRATED, number], 1), np.random.default_rng([DEMONSTRATED, number])
    try:
        session = Teleoperation(task, physics, start if after is None else reached_by(after, task, physics, start))
        return perform(session, script, noise=noise, rng=rng)
    except UserError as error:
        raise UserError(f"layout {number}: {error}") from error


def reached_by(tree: Tree, task: Task, physics: Physics, start: World) -> World:
    """Return the state in which a tree ends. Raise UserError if it leaves something in the gripper."""
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    final = play(semantics, Settler(task, physics), tree, start).final
    if final.held[0] >= 0:
        raise UserError("the tree ends with an object in the gripper; demonstrate from the start instead")
    return final
