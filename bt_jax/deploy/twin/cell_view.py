"""Pictures of the whole cell, robot and tables, from the front left."""

from __future__ import annotations

import copy

import mujoco
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.arrays import ColorImage
from bt_jax.deploy.twin.cell import FILM, Qpos, TwinScene
from bt_jax.mjx_env.render.offscreen import View

__all__ = ["CellView"]


class CellView:
    """Draws states of a scene's model; made and used in one thread. Raise UserError if nothing can be drawn here."""

    def __init__(self, scene: TwinScene, *, width: int, height: int, shadows: bool = True) -> None:
        model = copy.copy(scene.model)
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        model.vis.quality.offsamples = 4
        self._model, self._data = model, mujoco.MjData(model)
        self._view = View(model, FILM, width=width, height=height, shadows=shadows)

    def __call__(self, qpos: Qpos) -> ColorImage:
        """Return a picture of a state."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return self._view(self._data)

    def move(self, kit: str, pose: RigidTransform) -> None:
        """Show a kit, which is not part of the state, at another pose in the world from now on."""
        place = self._model.body(kit).mocapid[0]
        self._data.mocap_pos[place] = pose.translation
        self._data.mocap_quat[place] = pose.rotation.as_quat(scalar_first=True)

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._view.close()
