"""Takes the arms home after a stop, tick by tick, and stops them where the camera fails or time runs out."""

from __future__ import annotations

from collections.abc import Mapping

from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.observer import Perceiving
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.encoding.status import Status

__all__ = ["take_home"]

SECONDS = 120.0  # within which the arms must be home
FIRST = 2.0  # s for the camera to see what is there


def take_home(
    link: RobotLink, skills: RobotSkills, perception: Perceiving | None, limits: Limits | None = None, *, keep: bool
) -> str:
    """Recover, with what the hands hold if `keep`, else without; return why the arms are not home, "" if they are.
    Without `perception` nothing is kept clear of but tables, body and arms."""
    limits = limits or Limits()
    end = link.now() + FIRST
    while perception is not None and not perception.poses(link.now()) and link.now() < end:
        link.wait(link.now() + limits.tick)
    skills.recover(keep=keep)
    end = link.now() + SECONDS
    while (stopped := link.stopped()) is None:
        try:
            seen = _seen(link, perception, limits)
        except Exception as problem:  # of whatever looks: the arms no longer know what is in their way
            link.stop(f"the camera has failed: {problem}")
            continue
        status = skills.poll(seen)
        if status != Status.RUNNING:
            return "" if status == Status.SUCCESS else f"the arms are not home: {skills.reason}"
        if not link.now() < end:
            skills.cancel()
            return f"the arms are not home after {SECONDS:g} s"
        link.wait(link.now() + limits.tick)
    more = link.stop(stopped)
    return f"{stopped}; {more}" if more else stopped


def _seen(link: RobotLink, perception: Perceiving | None, limits: Limits) -> Observation:
    """Return what is known now. Raise UserError if the camera has told nothing new for long."""
    now = link.now()
    poses: Mapping[str, RigidTransform] = {}
    if perception is not None:
        perception.update()
        if not now - perception.image <= limits.image:
            why = f" ({perception.lost})" if perception.lost else ""
            raise UserError(f"no new image for {now - perception.image:.1f} s{why}; check the camera's cable")
        poses = perception.poses(now)
    return Observation(now, poses, {arm: link.arm(arm).opening for arm in link.arms}, None)
