"""Demonstrate a pyramid in simulation, learn a tree from it, and say why the tree is as it is."""

from bt_jax.lfd import Demonstrations, Frames, learn
from bt_jax.lfd.explanation import action_rows
from bt_jax.mjx_env import make_physics
from bt_jax.tasks import load_task
from bt_jax.teaching import parse_script, record

SCRIPT = """
pick YellowBox
to (-0.133, 0, 0.055) KittingBox
release
pick BlueBox
to (0, 0, 0.055) KittingBox
release
pick GreenBox
to (-0.065, 0, 0.155) KittingBox
release
"""

task = load_task("pyramid")
shown = record(task, make_physics(task), parse_script(SCRIPT), count=3, noise=0.003)
lesson = learn(Demonstrations(Frames.of(task), tuple(shown)), task)

for row in action_rows(lesson):
    print(f"{row['what']} ({row['seen']})\n    {row['why']}")
print(lesson.tree)
