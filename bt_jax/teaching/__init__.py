"""Where demonstrations come from: a person at a simulated gripper, a script of what that person does, or a person whom a
camera watches (`teaching.watch`)."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
