from bt_jax.gp.achievements.goals import Goals, Measured
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig, Selection
from bt_jax.gp.evolution import Evolution, Generation, Population, State, best_of
from bt_jax.gp.search import AchievementSearch
from bt_jax.gp.validity import is_valid

__all__ = [
    "AchievementSearch",
    "Alphabet",
    "Evolution",
    "GPConfig",
    "Generation",
    "Goals",
    "Measured",
    "Population",
    "Selection",
    "State",
    "best_of",
    "is_valid",
]
