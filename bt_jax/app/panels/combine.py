"""Step: combine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from bt_jax.app.studio import Studio

if TYPE_CHECKING:
    from bt_jax.app.page import Page

__all__ = ["build"]


def build(studio: Studio, page: Page) -> None:
    """The panel."""
    ui.label("combine")
