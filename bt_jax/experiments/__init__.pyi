from bt_jax.experiments.protocol import EXPERIMENTS, Experiment, VariantResult, perform
from bt_jax.experiments.published import PublishedCurve, published_curves

__all__ = [
    "EXPERIMENTS",
    "Experiment",
    "PublishedCurve",
    "VariantResult",
    "perform",
    "published_curves",
]
