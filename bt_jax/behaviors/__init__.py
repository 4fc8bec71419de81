"""The nodes that trees are made of, the pool that evolution draws from, and the notation of leaves."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
