"""What the robot's twin does and waits for, in words."""

from __future__ import annotations

from bt_jax.app.plain_words import Words
from bt_jax.app.processes.twin_messages import Ended, Tick
from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.decision import Step
from bt_jax.deploy.execution.recorded import RecordedRun

__all__ = ["age_words", "doing", "moment_words", "outcome_words", "waiting_for"]

FRESH = 0.7  # seconds within which something is seen now
COMMITTED, SETTLING, PAUSING = "committed", "settling", "pausing"  # phases of a run in which the tree is not ticked


def doing(words: Words, tick: Tick) -> str:
    """Say what is being done."""
    action = None if tick.action is None else words(parse_behavior(tick.action))
    if tick.phase == Step.LOOKING:
        return "The arms get out of the camera's way"
    if tick.phase == PAUSING:
        return "The arms pause"
    if tick.phase == SETTLING:
        return "The camera looks at what has changed"
    if tick.phase == Step.WAITING or action is None:
        return "The tree wants nothing more"
    return f"{action}: not to be broken off now" if tick.phase == COMMITTED else action


def waiting_for(tick: Tick) -> str:
    """Say what it waits for, "" if for nothing."""
    doubts = "; ".join(tick.doubts)
    if tick.phase == Step.LOOKING:
        return f"Waits until it sees more: {doubts}." if doubts else "Waits until it sees all that the tree asks about."
    if tick.phase == PAUSING:
        return f"Waits until the picture is right again: {doubts}."
    if tick.phase == Step.WAITING:
        return f"Waits, to be sure that it stays so.{f' {doubts[:1].upper()}{doubts[1:]}.' if doubts else ''}"
    return f"Notices: {doubts}." if doubts else ""


def age_words(tick: Tick, name: str) -> str:
    """Say how long ago an object or a kit was seen."""
    if name in tick.away:
        return "taken away"
    if tick.holding == name:
        return "in the hand"
    age = tick.ages.get(name)
    if age is None:
        return "not seen yet"
    return "seen" if age < FRESH else f"not seen for {age:.0f} s"


def moment_words(words: Words, record: RecordedRun, at: int) -> str:
    """Say what is done at a moment of a run that is looked back at."""
    moment = record.moments[at]
    action = None if moment.action is None else str(moment.action)
    tick = Tick(moment.time, None, moment.phase, action, moment.seen.holding, [], [], {})
    said = f"{moment.time:.1f} s: {doing(words, tick)}"
    if at < len(record.moments) - 1:
        return said
    return f"{said}. End: {record.reason or 'the log breaks off here'}"


def outcome_words(ended: Ended) -> str:
    """Say how a run has ended."""
    if ended.interrupted:
        return "Stopped: the arms rest."
    after = f"after {ended.seconds:.0f} s"
    return f"Done {after}: {ended.reason}." if ended.solved else f"Ended without success {after}: {ended.reason}."
