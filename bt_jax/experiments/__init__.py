"""The experiments of the paper: evolution with a demonstration and alone, repeated and reported."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
