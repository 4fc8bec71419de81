"""A learnt tree on a robot, or on its twin: perception, planning, the link to the controller, execution.

Nothing of this was ever tried on a real robot. Importing it needs no extra; using a name may need `bt_jax[robot]`.
"""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
