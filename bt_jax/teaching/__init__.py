"""Where demonstrations come from: a person at a simulated gripper, or a script of what that person does."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
