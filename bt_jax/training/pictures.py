"""The pictures in a run folder: the learning curve, and the scene after an episode of the learnt tree."""

from __future__ import annotations

from bt_jax.behaviors import Tree, Vocabulary
from bt_jax.encoding.walk import leaves
from bt_jax.gp.evolution import Generation
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.render.film import final_picture
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.training.levels import make_level
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder

__all__ = ["draw_pictures"]


def draw_pictures(
    folder: RunFolder, config: RunConfig, tree: Tree, history: list[Generation], settler: Settler | None = None
) -> None:
    """Write the pictures of a run; that of the scene, in the first training layout, only if there is a renderer.

    `settler` lets the boxes fall (default: one of the run's level).
    """
    from bt_jax.training.plots import learning_curve  # heavy: Matplotlib, after everything is said

    folder.save_picture("learning_curve.png", learning_curve(history, title=config.task.name, phases=folder.phases()))
    settler = settler or Settler(config.task, make_level(config.task, config.settings))
    layouts = sample_layouts(config.task, config.gp.seed, config.settings.layouts_of(config.task))
    semantics = LeafSemantics(config.task, Vocabulary.of(leaves(tree)))
    scene = final_picture(config.task, play(semantics, settler, tree, take(layouts, slice(1))))
    if scene is not None:
        folder.save_picture("final_scene.png", scene)
        (folder.path / "solved.png").unlink(missing_ok=True)  # of an earlier version, and of an earlier tree
