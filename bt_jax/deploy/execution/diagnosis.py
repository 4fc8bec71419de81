"""Why a run does not get on: what is not seen and since when, what is wrong with the picture, and which attempts failed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bt_jax.behaviors import Behavior, Kind
from bt_jax.deploy.execution.action_runner import ActionRunner
from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.settings import Limits
from bt_jax.tasks import Task

__all__ = ["Diagnosis", "joined"]


class Diagnosis:
    """Of the run of one tree with these `leaves`. `conditions` are all that it speaks of, also as effects of its actions."""

    def __init__(self, task: Task, leaves: Iterable[Behavior], runner: ActionRunner, limits: Limits) -> None:
        self.task, self.runner, self.limits = task, runner, limits
        leaves = list(leaves)
        conditions = [c for leaf in leaves for c in ([leaf] if leaf.kind == Kind.CONDITION else leaf.postconditions)]
        self.conditions = tuple(dict.fromkeys(conditions))
        named = {name for leaf in (*leaves, *conditions) for name in (leaf.object, leaf.frame) if name}
        self._objects = {one for name in named for one in task.instances.get(name, (name,))}
        self._hidden: list[str] = []  # boxes and kit that are not seen now
        self._seen_at: dict[str, float] = {}  # when each was seen last, or looked for first
        self._findings: tuple[Finding, ...] = ()  # about the tree's objects and the picture
        # What findings that stop a run are about, and whether something hides it; since when.
        self._found_at: dict[tuple[str, bool], float] = {}

    def take(self, seen: Observation) -> str:
        """Take note of what is seen now. Return what has made it wrong for too long, "" if nothing has."""
        self._seen_at.update(dict.fromkeys(seen.poses, seen.time))
        objects = (*self.task.object_names, *self.task.kit_names)
        self._seen_at = dict.fromkeys(objects, seen.time) | self._seen_at
        self._hidden = [name for name in objects if name not in (*seen.poses, seen.holding)]
        self._findings = tuple(
            f for f in seen.findings if (f.about in self._objects or not f.about) and not f.missing
        )  # what is missing is among what is hidden
        stopping = {(finding.about, bool(finding.sight)): finding for finding in self._findings if finding.stops}
        self._found_at = {key: self._found_at.get(key, seen.time) for key in stopping}
        return "; ".join(
            stopping[key].text
            for key, since in self._found_at.items()
            if seen.time - since >= (self.limits.covered if stopping[key].sight else self.limits.finding)
        )

    @property
    def doubt(self) -> str:
        """What makes wrong now what is known, "" if nothing does."""
        return "; ".join(finding.text for finding in self._findings if finding.stops)

    def patience(self, undecided: frozenset[Behavior], now: float) -> float:
        """Return how long the tree may fail [s]: half as long where what it misses has not been seen for long, or an action
        has been tried as often as it may be."""
        times = [self._seen_at[name] for name in self._missing(undecided)]
        lost = now - max(times, default=now) >= self.limits.unseen
        hopeless = lost or bool(self.runner.exhausted(self.task.episode.action_ticks))
        return self.limits.patience / 2 if hopeless else self.limits.patience

    def hopeless(self, action: Behavior, undecided: frozenset[Behavior], now: float, *, looked: bool) -> str:
        """Return why an action need not be begun, "" if it may work: what it acts on has not been seen for long, though it
        was looked for, or missing in an attempt; or the tree wants it only because of `undecided` places in frames that
        have not been seen for long either, so that nothing can be placed there. A `look` is how to wait for that."""
        gone = [] if action.name == "look" else self._gone([action.object, action.frame], now)
        if gone and (looked or action in self.runner.failures):
            return joined(f"{action} cannot be carried out", self.troubles(frozenset([action])))
        gone = self._gone([condition.frame for condition in undecided if condition.name == "at"], now)
        if gone and looked:
            return joined(f"there is no use in {action}", [*self.troubles(), _not_seen(gone)])
        return ""

    def repeated(self) -> str:
        """Return which action was broken off again and again without anything achieved, and why, "" if none was."""
        reason = self.runner.repeated(self.limits.broken_off)
        return reason and joined(reason, map(str, self._findings))

    def troubles(self, undecided: frozenset[Behavior] = frozenset()) -> list[str]:
        """Return what went wrong and still does, each a clause; `undecided` are the conditions that cannot be decided."""
        reasons, troubles = self.runner.reasons, list(map(str, self._findings))
        for action, count in self.runner.failures.items():
            why = f" ({reasons[action]})" if action in reasons else ""
            troubles.append(f"{action} failed {'once' if count == 1 else f'{count} times'}{why}")
        unseen = self._missing(undecided)
        return troubles + ([_not_seen(unseen)] if unseen else [])

    def _gone(self, names: Sequence[str | None], now: float) -> list[str]:
        """Return which of them have not been seen for long."""
        meant = {one for name in names if name is not None for one in self._meant(name)}
        return [name for name in self._hidden if name in meant and now - self._seen_at[name] >= self.limits.unseen]

    def _missing(self, undecided: frozenset[Behavior]) -> list[str]:
        """Return what is not seen that keeps conditions from being decided: what they name, else all that is hidden, which
        may stand on it."""
        names = (name for condition in undecided for name in (condition.object, condition.frame))
        named = {one for name in names if name is not None for one in self.task.instances.get(name, (name,))}
        return [name for name in self._hidden if name in named] or (self._hidden if undecided else [])

    def _meant(self, name: str) -> Sequence[str]:
        """Return what must be seen for something named: itself, or any instance of a part."""
        instances = self.task.instances.get(name, (name,))
        return instances if all(one in self._hidden for one in instances) else ()


def _not_seen(names: list[str]) -> str:
    return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} not seen"


def joined(reason: str, why: Iterable[str]) -> str:
    """Return a reason and what it is due to, as one sentence."""
    return ": ".join(filter(None, [reason, "; ".join(why)]))
