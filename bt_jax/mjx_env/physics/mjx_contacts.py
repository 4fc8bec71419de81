"""Contacts of MJX, made those of the C engine."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float32

from bt_jax.mjx_env.physics._mjx import mjx

__all__ = ["Contacts", "without_edges"]


def without_edges(placed: mjx.Model) -> mjx.Model:
    """Return the model with meshes that touch with faces and corners only. Where a face is as good, MJX prefers two edges
    of meshes, however far apart along the face: a prism on a table would be held by one point beside it, and creep."""
    meshes = [
        mesh
        if mesh is None
        else mesh.replace(edge=np.zeros((1, 2), np.int32), edge_face_normal=mesh.edge_face_normal[:1])
        for mesh in placed._impl.mesh_convex
    ]
    return placed.tree_replace({"_impl.mesh_convex": tuple(meshes)})


class Contacts:
    """What the contacts of a model depend on; `size` [m] is that of its smallest object."""

    def __init__(self, model: mujoco.MjModel, placed: mjx.Model, size: float) -> None:
        self.placed, self.size = placed, size
        self.normals, self.offsets = _faces(model, placed)

    def as_in_c(self, data: mjx.Data) -> Any:  # the class of MJX's contacts is private
        """Return the contacts by the C engine's conventions: halfway between the surfaces (MJX leaves those of two faces on
        one of them), and each place once (MJX fills up to four by repetition, which would stiffen the contact)."""
        contact = data._impl.contact
        geoms = contact.geom
        normal = contact.frame[:, 0]
        outward = jnp.stack([normal, -normal], axis=1)
        local = jnp.einsum("ckij,cki->ckj", data.geom_xmat[geoms], contact.pos[:, None] - data.geom_xpos[geoms])
        facing = jnp.einsum("ckij,cki->ckj", data.geom_xmat[geoms], outward)
        normals, offsets = jnp.asarray(self.normals)[geoms], jnp.asarray(self.offsets)[geoms]
        outside = jnp.einsum("ckfj,ckj->ckf", normals, local) - offsets
        face = jnp.argmax(jnp.einsum("ckfj,ckj->ckf", normals, facing), axis=-1, keepdims=True)
        outside = jnp.take_along_axis(outside, face, axis=-1)[..., 0]
        depth = jnp.abs(contact.dist)
        toward_second = jnp.clip(outside[:, 1] - outside[:, 0], -depth, depth) / 2
        plane = jnp.asarray(self.placed.geom_type)[geoms[:, 0]] == int(mujoco.mjtGeom.mjGEOM_PLANE)
        between = contact.pos + jnp.where(plane, 0, toward_second)[:, None] * normal
        near = jnp.sum((contact.pos[:, None] - contact.pos[None]) ** 2, axis=-1) < (1e-3 * self.size) ** 2
        alike = near & jnp.all(geoms[:, None] == geoms[None], axis=-1)
        again = jnp.any(jnp.tril(alike, -1), axis=1)
        return contact.replace(pos=between, dist=jnp.where(again, 1.0, contact.dist))


def _faces(model: mujoco.MjModel, placed: mjx.Model) -> tuple[Float32[np.ndarray, "G F 3"], Float32[np.ndarray, "G F"]]:
    """Return the normals of the faces of every geom in its own frame, and how far they are from its middle; zeros for
    planes and behind the last face."""
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    found = []
    for kind, size, mesh in zip(model.geom_type, model.geom_size, model.geom_dataid, strict=True):
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            convex = placed._impl.mesh_convex[mesh]
            normals, corners = np.asarray(convex.face_normal), np.asarray(convex.face)[:, 0]
            found.append((normals, np.sum(normals * corners, axis=1)))
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            found.append((sides, np.tile(size, 2)))
        else:
            found.append((np.zeros((0, 3)), np.zeros(0)))
    most = max(len(offsets) for _, offsets in found)
    normals = np.array([np.pad(one, ((0, most - len(one)), (0, 0))) for one, _ in found], np.float32)
    return normals, np.array([np.pad(one, (0, most - len(one))) for _, one in found], np.float32)
