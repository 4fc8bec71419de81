"""The server of the page: one studio, which every window shows."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from fastapi.responses import HTMLResponse, PlainTextResponse, Response
from nicegui import app, ui

from bt_jax._util.errors import UserError
from bt_jax.app.access.guard_hosts import GuardHosts
from bt_jax.app.access.guard_login import GuardLogin
from bt_jax.app.access.logins import Logins
from bt_jax.app.page import Page
from bt_jax.app.phrases import phrase
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.app.report import report
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.tasks import problems

__all__ = ["serve"]

WATCH_SECONDS = 0.1  # between two readings of the evolution's progress
HOLD_SECONDS = 0.5  # between two looks at who steers what
RECONNECT_SECONDS = 30.0  # for which a window that is not heard of is kept, on a busy machine


def serve(
    folder: Path,
    *,
    host: str,
    port: int,
    names: frozenset[str],
    token: str,
    show: str | bool,
    warm_worker: WarmWorker,
    hold_factor: float,
) -> None:
    """Serve the page, which works in a folder, until it is interrupted; the first evolution is done by `warm_worker`.

    It answers to `names` besides loopback's, and lets only those in who know the `token`, everybody if it is empty. `show`
    is the path that a browser opens, `hold_factor` that of `state.holds`.
    """
    if token:
        app.add_middleware(GuardLogin, logins=Logins(token))
    app.add_middleware(GuardHosts, names=names)  # added last, asked first
    workspace = Workspace(folder)
    studio = Studio(workspace, workspace.task("stack"), warm_worker, hold_factor)
    studio.restore()

    def prepare() -> None:
        if not problems(studio.edited.task):
            studio.evolution.prepare(studio.edited.task)

    app.on_startup(prepare)
    studio.bus.subscribe("task", prepare)
    studio.bus.subscribe("evolution", prepare)
    app.on_shutdown(studio.evolution.close)
    app.on_shutdown(studio.robot.close)
    app.on_shutdown(studio.correction.close)
    app.on_shutdown(studio.drafts.kept)
    app.timer(WATCH_SECONDS, studio.watch)
    app.timer(WATCH_SECONDS, studio.robot.poll)
    app.timer(HOLD_SECONDS, studio.holds.expire)

    @ui.page("/")
    def window(step: str = "") -> None:
        Page(studio, step)

    @app.get("/report/{name}")
    def of_run(name: str) -> Response:
        try:
            return HTMLResponse(report(workspace.run(name), today=datetime.now()))
        except UserError as error:
            return PlainTextResponse(phrase(error, folder), status_code=404)

    @app.get("/robot/{name}.jpg")
    def picture(name: str) -> Response:
        found = studio.robot.pictures.get(name)
        headers = {"Cache-Control": "no-store"}
        return Response(found or b"", 404 if found is None else 200, headers=headers, media_type="image/jpeg")

    app.config.quasar_config["loadingBar"]["skipHijack"] = True  # a bar without a name, at every request
    ui.run(
        host=host,
        port=port,
        title="bt_jax",
        language="en-US",
        dark=None,
        show=show,
        reload=False,
        reconnect_timeout=RECONNECT_SECONDS,
        show_welcome_message=False,
    )
