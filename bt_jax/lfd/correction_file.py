"""Corrections as keys of `info.yaml`, by the names of demonstrations and the numbers of their actions, counted from 1:

    chosen: {demo1: {2: KittingBox}}       what the place of action 2 is relative to
    turns: {demo1: {2: 90, 4: any}}        how the object lies there, degrees
    orders: {demo1: {2: {4: false}}}       action 2 need not come before action 4
    itself: {Bolt1: true}                  Bolt1 is meant, and no other Bolt

What says nothing valid is left out: a file may have been written by hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from bt_jax.lfd.corrections import Corrections, Instance

__all__ = ["KEYS", "corrections_of", "forgotten", "renamed", "said_of"]

ACTIONS = ("chosen", "turns", "orders")  # keys that tell something of the actions of demonstrations
KEYS = (*ACTIONS, "itself")
ANY = "any"
Said = dict[str, dict[Any, Any]]


def corrections_of(info: Mapping[str, Any], names: Sequence[str]) -> Corrections:
    """Return what `info.yaml` says about demonstrations with these names, in their order."""
    frames, turns, orders = (_actions(info, key, names) for key in ACTIONS)
    itself = info.get("itself")
    return Corrections(
        {one: frame for one, frame in frames.items() if isinstance(frame, str)},
        {one: None if turn == ANY else float(turn) for one, turn in turns.items() if _is_turn(turn)},
        {
            (one, Instance(one.demonstration, number - 1)): meant
            for one, after in orders.items()
            if isinstance(after, Mapping)
            for number, meant in after.items()
            if _is_number(number) and isinstance(meant, bool)
        },
        {name: meant for name, meant in itself.items() if isinstance(name, str) and isinstance(meant, bool)}
        if isinstance(itself, Mapping)
        else {},
    )


def said_of(corrections: Corrections, names: Sequence[str]) -> Said:
    """Return what `info.yaml` has to say, by its keys."""
    said: Said = {key: {} for key in KEYS}
    for one, frame in corrections.frames.items():
        said["chosen"].setdefault(names[one.demonstration], {})[one.index + 1] = frame
    for one, turn in corrections.turns.items():
        said["turns"].setdefault(names[one.demonstration], {})[one.index + 1] = ANY if turn is None else turn
    for (one, other), meant in corrections.orders.items():
        after = said["orders"].setdefault(names[one.demonstration], {}).setdefault(one.index + 1, {})
        after[other.index + 1] = meant
    return {**said, "itself": dict(corrections.itself)}


def renamed(info: Mapping[str, Any], names: Mapping[str, Sequence[str]]) -> Said:
    """Return what is said of actions with each demonstration under its new names, of which there may be several."""
    return {
        key: {new: actions for name, actions in _mapping(info, key).items() for new in names.get(name, (name,))}
        for key in ACTIONS
    }


def forgotten(info: Mapping[str, Any], name: str) -> Said:
    """Return what is said of actions, without those of a demonstration."""
    return renamed(info, {name: ()})


def _actions(info: Mapping[str, Any], key: str, names: Sequence[str]) -> dict[Instance, Any]:
    return {
        Instance(names.index(name), number - 1): value
        for name, actions in _mapping(info, key).items()
        if name in names and isinstance(actions, Mapping)
        for number, value in actions.items()
        if _is_number(number)
    }


def _mapping(info: Mapping[str, Any], key: str) -> Mapping[Any, Any]:
    found = info.get(key)
    return found if isinstance(found, Mapping) else {}


def _is_number(number: object) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and number > 0


def _is_turn(turn: object) -> bool:
    return turn == ANY or (isinstance(turn, int | float) and not isinstance(turn, bool) and math.isfinite(turn))
