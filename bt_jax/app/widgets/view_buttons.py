"""Buttons in the corner of the scene that show it from where a person wants to look."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.widgets.scene_view import SceneView

__all__ = ["view_buttons"]

VIEWS = (
    ("home", "home", "The whole scene, as at the beginning"),
    ("front", "crop_portrait", "From the front"),
    ("side", "switch_left", "From the right side"),
    ("top", "vertical_align_bottom", "From above"),
    ("nearer", "zoom_in", "Nearer (+)"),
    ("farther", "zoom_out", "Farther (-)"),
)


def view_buttons(scene: SceneView) -> None:
    """Build the buttons into the container that is open; the browser looks from there without asking the server."""
    with ui.element("div").classes("scene-views").props('role=group aria-label="View"'):
        for view, icon, text in VIEWS:
            button = ui.button(icon=icon, color=None).props(
                f'dense unelevated data-testid=view-{view} aria-label="{text}" title="{text}"'
            )
            button.on("click", js_handler=f"() => getElement({scene.id}).look('{view}')")
