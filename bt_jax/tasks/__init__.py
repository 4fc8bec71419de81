"""Tasks: what a scene holds and what should become of it, written as YAML files."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
