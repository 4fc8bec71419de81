"""Plan a tree from the targets of a task, and start an evolution from it."""

import bt_jax

task = bt_jax.load_task("pyramid")
plan = bt_jax.plan_task(task)
print("planned", plan)

config = bt_jax.GPConfig(generations=10, seed=0)
for name, baseline in (("alone", None), ("from the plan", plan)):
    result = bt_jax.evolve(task, config, baseline=baseline)
    print(f"evolved {name}: fitness {result.fitness:.1f}, solves {result.success_rate:.0%} of unseen layouts")
