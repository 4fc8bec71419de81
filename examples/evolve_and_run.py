"""Evolve a tree for a packaged task, then watch one episode of it, tick by tick."""

import bt_jax
from bt_jax.behaviors import Vocabulary
from bt_jax.encoding import leaves
from bt_jax.mjx_env import LeafSemantics, Settler, make_physics, play, sample_layouts

task = bt_jax.load_task("stack")
result = bt_jax.evolve(task, bt_jax.GPConfig(generations=30, seed=0))
print(result.tree)
print(f"fitness {result.fitness:.1f}, solves {result.success_rate:.0%} of {len(result.test.solved)} unseen layouts")

semantics = LeafSemantics(task, Vocabulary.of(leaves(result.tree)))
episode = play(semantics, Settler(task, make_physics(task)), result.tree, sample_layouts(task, seed=7, count=1))
for number, tick in enumerate(episode.ticks, start=1):
    print(f"tick {number}: {tick.status.name:7s} {tick.command or ''}")
print(f"ended with {episode.ending.name}; {1000 * episode.misses.distance.max():.1f} mm from the farthest target")
