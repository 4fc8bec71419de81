from bt_jax.mjx_env.episodes.evaluator import Evaluation, TableEvaluator
from bt_jax.mjx_env.episodes.playback import EpisodeState, Playback, Tick, play
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Physics, Settled
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.render.film import film
from bt_jax.mjx_env.render.offscreen import Renderer
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World

__all__ = [
    "Ending",
    "EpisodeState",
    "Evaluation",
    "Kinematic",
    "LeafSemantics",
    "Physics",
    "Playback",
    "Renderer",
    "RolloutEvaluator",
    "Settled",
    "Settler",
    "TableEvaluator",
    "Tick",
    "World",
    "film",
    "make_physics",
    "play",
    "sample_layouts",
]
