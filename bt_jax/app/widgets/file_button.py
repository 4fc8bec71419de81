"""A button that asks for a file of the computer on which the browser runs."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence

from nicegui import ui
from nicegui.events import UploadEventArguments

from bt_jax._util.errors import UserError
from bt_jax.app.widgets.context import PageContext

__all__ = ["file_button"]


def file_button(
    text: str,
    testid: str,
    icon: str,
    page: PageContext,
    *,
    endings: Sequence[str],
    largest: int,
    chosen: Callable[[str, bytes], Awaitable[None]],
) -> ui.button:
    """Return a button that lets a person choose a file and calls `chosen` with its name and what is in it; a file of more
    than `largest` bytes is refused."""

    async def read(event: UploadEventArguments) -> None:
        uploader.reset()
        if event.file.size() > largest:
            raise UserError(f"{event.file.name} is larger than {largest // 1_000_000} MB; choose another file")
        await chosen(event.file.name, await event.file.read())

    uploader = ui.upload(on_upload=page.guard(read), auto_upload=True).classes("file-button-upload")
    uploader.props(f'accept="{",".join(endings)}" data-testid={testid}-file aria-hidden=true')
    made = ui.button(text, icon=icon).classes("part-button").props(f"no-caps unelevated dense data-testid={testid}")
    # In the browser itself: it opens its dialog for files only as an answer to a click.
    made.on("click", js_handler=f"() => getElement({uploader.id}).$refs.qRef.pickFiles()")
    return made
