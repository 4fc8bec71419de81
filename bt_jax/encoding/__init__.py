"""Trees as integer arrays and as text, XML and pictures; ticking one tree or a whole population."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
