"""Training: an evolution bound to a task, the folder that a run leaves behind, and how a run goes on."""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
