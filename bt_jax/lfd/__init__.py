"""Learning from demonstration: frames, goals and orders inferred from a few demonstrations, and a tree planned from them."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
