"""Behavior Trees for pick-and-place: evolved in JAX, simulated in MuJoCo, readable by people.

    import bt_jax

    result = bt_jax.evolve(bt_jax.load_task("stack"), bt_jax.GPConfig(population=64))
    print(result.tree, result.success_rate)
    result.save("runs/mine")

The packages in it have public faces of their own, for instance `bt_jax.gp` and `bt_jax.encoding`.
"""

from bt_jax._util.lazy import lazy_face
from bt_jax.behaviors.nodes import Drawing

__version__ = "0.1.0"
__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)

Drawing.to_svg = lambda tree: __getattr__("to_svg")(tree)
