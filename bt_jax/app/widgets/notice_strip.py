"""The strip above the scene and the panel with the notices that stand."""

from __future__ import annotations

import functools
import inspect

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.state.notices import Discard, Notice, Notices
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.dialogs import ask

__all__ = ["NoticeStrip"]


class NoticeStrip:
    """Built into the container that is open."""

    def __init__(self, notices: Notices, page: PageContext) -> None:
        self._notices, self._page = notices, page
        self._area = ui.element("div").classes("notices").props("data-testid=notices role=status")
        page.on("notices", self._show)

    def _show(self) -> None:
        self._area.clear()
        with self._area:
            for notice in self._notices.standing:
                with ui.element("div").classes("notice"):
                    ui.icon("info").props("aria-hidden=true")
                    ui.label(notice.text).classes("notice-text")
                    if notice.discard is not None:
                        discard = self._page.guard(
                            functools.partial(self._discard, notice, notice.discard), steers=notice.discard.steers
                        )
                        ui.button("Discard", on_click=discard).props("flat dense no-caps data-testid=notice-discard")
                    close = self._page.guard(functools.partial(self._notices.remove, notice))
                    ui.button("OK", on_click=close).props("flat dense no-caps data-testid=notice-close")

    async def _discard(self, notice: Notice, discard: Discard) -> None:
        if not await ask(discard.question, yes="Discard", testid="notice-discard"):
            return
        self._page.steer(discard.steers)  # again: a person may take their time to answer
        if notice not in self._notices.standing:
            raise UserError("it was changed in another window meanwhile; look at it before you discard it")
        result = discard.do()
        if inspect.isawaitable(result):
            await result
        self._notices.remove(notice)
