"""Genetic programming with Behavior Trees of any domain: valid trees only, whole populations at once."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
