"""Instances of a part that nothing tells apart: states that differ only by swapping them are one state (NumPy)."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Int

from bt_jax.behaviors import subgoal_conditions
from bt_jax.mjx_env.selection import atoms_of
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, order_of_rows

__all__ = ["in_order", "interchangeable"]


def interchangeable(semantics: LeafSemantics) -> tuple[Int[np.ndarray, " _"], ...]:
    """Return the indices of the instances of each part that has several equal ones, where no leaf, no target and no subgoal
    names one of them."""
    task = semantics.task
    behaviors = [atom for leaf in semantics.vocabulary.leaves for atom in atoms_of(leaf)]
    behaviors += [condition for meaning in subgoal_conditions(task).values() for condition in meaning]
    names = {name for one in behaviors for name in (one.object, one.frame)}
    names |= {name for target in task.targets for name in (target.object, target.frame)}
    groups = []
    for part in dict.fromkeys(thing.part for thing in task.objects if thing.part):
        own = [i for i, thing in enumerate(task.objects) if thing.part == part]
        things = [task.objects[i] for i in own]
        if len(own) > 1 and len({thing.body for thing in things}) == 1 and names.isdisjoint(t.name for t in things):
            groups.append(np.array(own))
    return tuple(groups)


def in_order(world: World, groups: tuple[Int[np.ndarray, " _"], ...]) -> World:
    """Return snapped states with the objects of each group in the order of their poses; which of them is held follows."""
    if not groups:
        return world
    order = np.tile(np.arange(world.poses.shape[1]), (len(world.held), 1))  # the object that comes in the place of each
    for own in groups:
        order[:, own] = own[order_of_rows(world.poses[:, own])]
    held = np.take_along_axis(np.argsort(order, axis=1), np.maximum(world.held, 0)[:, None].astype(int), axis=1)[:, 0]
    return dataclasses.replace(
        world,
        poses=np.take_along_axis(world.poses, order[..., None], axis=1),
        held=np.where(world.held < 0, world.held, held).astype(np.int8),
        unseen=None if world.unseen is None else np.take_along_axis(world.unseen, order, axis=1),
    )
