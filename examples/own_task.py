"""Describe a task in Python, starting from a packaged one, and evolve a tree for it."""

import dataclasses

from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Target, load_task
from bt_jax.training.training import evolve

base = load_task("stack")
task = dataclasses.replace(
    base,
    name="two_corners",
    description="YellowBox and BlueBox in opposite corners of the kit.",
    targets=(
        Target("YellowBox", (-0.133, -0.133, 0.052), "KittingBox"),
        Target("BlueBox", (0.133, 0.133, 0.052), "KittingBox"),
    ),
    weights=dataclasses.replace(base.weights, node=5.0),
)

result = evolve(task, GPConfig(generations=40, seed=3))
for row in result.history[::10]:
    print(f"generation {row.generation:2d}: best {row.best:7.1f}, mean {row.mean:7.1f}")
print(result.tree)
print(f"solves {result.test.success_rate:.0%} of {len(result.test.solved)} unseen layouts")
