"""Nobody gets past the form without the token, on HTTP or on a websocket, with a clock that the test sets."""

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient, WebSocketDenialResponse
from starlette.websockets import WebSocketDisconnect

from bt_jax.app.access.guard_login import EXPIRED, GuardLogin
from bt_jax.app.access.logins import LOGIN_HOURS, WRONG_TOKENS

BROWSER = {"accept": "text/html,*/*"}


async def hello(request):
    return PlainTextResponse("hello")


async def echo(websocket):
    await websocket.accept()
    async for text in websocket.iter_text():
        await websocket.send_text(text)


@pytest.fixture
def page(logins):
    app = Starlette(routes=[Route("/", hello), Route("/other", hello), WebSocketRoute("/ws", echo)])
    return TestClient(GuardLogin(app, logins), follow_redirects=False)


def test_without_a_login_there_is_only_the_form(page):
    assert page.get("/other").status_code == 401
    assert page.get("/", headers=BROWSER).headers["location"] == "/login"
    form = page.get("/login")
    assert form.status_code == 401
    assert 'name="token"' in form.text
    assert "12 hours" in form.text
    with pytest.raises(WebSocketDenialResponse) as denied, page.websocket_connect("/ws"):
        pass
    assert denied.value.status_code == 401


@pytest.mark.parametrize("way", ["address", "form"])
def test_the_token_lets_in(page, way):
    answer = page.get("/login?token=secret") if way == "address" else page.post("/login", data={"token": "secret"})
    assert answer.status_code == 200
    cookie = answer.headers["set-cookie"].lower()
    assert all(part in cookie for part in ("httponly", "samesite=strict", "max-age=43200", "path=/"))
    assert "secret" not in cookie
    assert page.get("/").text == "hello"
    with page.websocket_connect("/ws") as socket:
        socket.send_text("hi")
        assert socket.receive_text() == "hi"


def test_wrong_tokens_are_refused_and_then_have_to_wait(page):
    for _ in range(WRONG_TOKENS):
        answer = page.post("/login", data={"token": "guess"})
        assert answer.status_code == 401
        assert "set-cookie" not in answer.headers
        assert "wrong" in answer.text
    answer = page.post("/login", data={"token": "secret"})
    assert answer.status_code == 429
    assert int(answer.headers["retry-after"]) > 0
    assert page.get("/login?token=secret").status_code == 429


@pytest.mark.parametrize(
    "body", [b"", b"token", b"token=" + b"x" * 10_000, b"&" * 100, b"token=%ff%00", b"\xff\xfe", b"token=<b>guess</b>"]
)
def test_any_other_form_is_refused(page, body):
    answer = page.post("/login", content=body)
    assert answer.status_code == 401
    assert "guess" not in answer.text


@pytest.mark.parametrize(
    "cookie", ["bt_jax_80=guess", "bt_jax_80=", "=;;=", "bt_jax_80", 'bt_jax_8080=x; bt_jax_80="a']
)
def test_a_cookie_that_was_made_up_is_no_login(page, cookie):
    assert page.get("/other", headers={"cookie": cookie}).status_code == 401


@pytest.mark.parametrize(
    "other", ['prefs={"a": 1}', "grafana[0]=q", "a b=1", "name=J%C3%BC", "name=J\xfc", '"', "=;;=", 'half="a']
)
def test_cookies_of_other_programs_on_the_host_do_not_log_out(page, other):
    answer = page.get("/login?token=secret")
    own = answer.headers["set-cookie"].partition(";")[0]
    page.cookies.clear()
    for cookie in (f"{other}; {own}", f"{own}; {other}"):
        assert page.get("/other", headers={"cookie": cookie.encode("latin-1")}).status_code == 200


@pytest.mark.parametrize("idle", [True, False])
def test_a_websocket_is_closed_when_the_login_ends(page, clock, idle):
    page.get("/login?token=secret")
    clock.now += 3600 * LOGIN_HOURS - 0.01
    with page.websocket_connect("/ws") as socket:
        if not idle:
            clock.now += 1
            socket.send_text("hi")
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
    assert closed.value.code == EXPIRED
    clock.now += 1
    assert page.get("/other").status_code == 401
