"""What a panel sees of the window that it is in."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.scene_view import SceneView

__all__ = ["PanelContext"]


@runtime_checkable
class PanelContext(PageContext, Protocol):
    """A window with the scene at its left."""

    @property
    def scene(self) -> SceneView:
        """The scene of this window."""
