"""Describe a task in Python, starting from a packaged one, and evolve a tree for it."""

import dataclasses

import bt_jax

base = bt_jax.load_task("stack")
task = dataclasses.replace(
    base,
    name="two_corners",
    description="YellowBox and BlueBox in opposite corners of the kit.",
    targets=(
        bt_jax.Target("YellowBox", (-0.133, -0.133, 0.052), "KittingBox"),
        bt_jax.Target("BlueBox", (0.133, 0.133, 0.052), "KittingBox"),
    ),
    weights=dataclasses.replace(base.weights, node=5.0),
)

result = bt_jax.evolve(task, bt_jax.GPConfig(generations=40, seed=3))
for row in result.history[::10]:
    print(f"generation {row.generation:2d}: best {row.best:7.1f}, mean {row.mean:7.1f}")
print(result.tree)
print(f"solves {result.success_rate:.0%} of {len(result.test.solved)} unseen layouts")
