"""Frames and turns chosen by a person, in place of the inferred ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.lfd.clustering import observe
from bt_jax.lfd.demonstration import Demonstrations, Instance
from bt_jax.lfd.inference import SAME_PLACE, Inference, placed
from bt_jax.tasks import Task

__all__ = ["with_chosen", "with_turns"]


def with_chosen(
    inferences: Sequence[Inference], demonstrations: Demonstrations, chosen: Mapping[Instance, str], task: Task
) -> tuple[Inference, ...]:
    """Return the inferences with the chosen frames; the frame of one instance is that of the whole inference.

    Inferences become one if they are at the same place in the chosen frame, in different demonstrations. Raise
    UserError if a frame is not a possible one.
    """
    found: list[Inference] = []
    decided = [_decided(inference, demonstrations, chosen, task) for inference in inferences]
    for one in sorted(decided, key=lambda inference: inference.chosen):  # chosen ones join those that are there
        same = next((other for other in found if one.chosen and _same(one, other)), None)
        if same is None:
            found.append(one)
        else:
            instances = tuple(sorted((*same.instances, *one.instances), key=lambda m: (m.demonstration, m.index)))
            known = max(same, one, key=lambda inference: len(inference.instances))
            found[found.index(same)] = _placed(known, demonstrations, one.frame, instances, one.reason, task)
    return tuple(sorted(found, key=lambda inference: min((m.index, m.demonstration) for m in inference.instances)))


def with_turns(inferences: Sequence[Inference], turns: Mapping[Instance, float | None]) -> tuple[Inference, ...]:
    """Return the inferences with the chosen turns; the turn of one instance is that of the whole inference. A slot tells its
    own."""
    found = []
    for one in inferences:
        said = [turns[instance] for instance in one.instances if instance in turns]
        if said and one.kind == "place" and not one.slot:
            note = "any turn will do" if said[0] is None else f"turned by {said[0]:g} degrees"
            one = dataclasses.replace(one, turn=said[0], note=f"{note}, as chosen by hand")
        found.append(one)
    return tuple(found)


def _decided(
    inference: Inference, demonstrations: Demonstrations, chosen: Mapping[Instance, str], task: Task
) -> Inference:
    """Return the inference in the frame chosen for one of its instances, the first if they differ."""
    frame = next((chosen[instance] for instance in inference.instances if instance in chosen), None)
    if frame is None:
        return inference
    if inference.kind == "pick":
        raise UserError(f"a pick is always relative to its object; choose a frame for a place of {inference.object}")
    own = task.instances.get(inference.object, (inference.object,))
    others = [name for name in demonstrations.frames.names if name not in own]
    if frame not in others:
        raise UserError(f"a place of {inference.object} cannot be in the frame '{frame}'; choose {', '.join(others)}")
    reason = "chosen by hand"
    if frame != inference.frame:
        reason += f"; the demonstrations alone say {inference.frame}: {inference.reason}"
    return _placed(inference, demonstrations, frame, inference.instances, reason, task)


def _placed(
    inference: Inference,
    demonstrations: Demonstrations,
    frame: str,
    instances: tuple[Instance, ...],
    reason: str,
    task: Task,
) -> Inference:
    rows = [one for one in observe(demonstrations, task) if one.instance in instances]
    one = placed(rows, task, frame, reason, inference.candidates, kits=[frame])
    return dataclasses.replace(one, tied=inference.tied, chosen=True)


def _same(one: Inference, other: Inference) -> bool:
    """Return whether two places of an object are one, seen in different demonstrations."""
    if (one.kind, one.object, one.frame) != (other.kind, other.object, other.frame):
        return False
    both = {m.demonstration for m in one.instances} & {m.demonstration for m in other.instances}
    return not both and float(np.linalg.norm(np.subtract(one.position, other.position))) < SAME_PLACE
