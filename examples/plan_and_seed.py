"""Plan a tree from the targets of a task, and start an evolution from it."""

from bt_jax.gp.config import GPConfig
from bt_jax.lfd import plan_task
from bt_jax.tasks import load_task
from bt_jax.training.training import evolve

task = load_task("pyramid")
plan = plan_task(task)
print("planned", plan)

config = GPConfig(generations=10, seed=0)
for name, baseline in (("alone", None), ("from the plan", plan)):
    result = evolve(task, config, baseline=baseline)
    print(f"evolved {name}: fitness {result.fitness:.1f}, solves {result.test.success_rate:.0%} of unseen layouts")
