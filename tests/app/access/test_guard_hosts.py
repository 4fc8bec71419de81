"""A page of somebody else cannot use this one, whatever name it makes resolve to this machine."""

import asyncio

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient, WebSocketDenialResponse

from bt_jax.app.access.guard_hosts import HEADERS, GuardHosts

LOOPBACK = ["127.0.0.1:8080", "localhost:8080", "LOCALHOST", "127.0.0.2:1", "[::1]:8080"]
FOREIGN = ["evil.example:8080", "127.0.0.1.evil.example", "localhost.evil.example:8080", "10.0.0.1", "", "a b", "[::1",
           "user@127.0.0.1", "127.0.0.1:x", "localhost:8080/x"]  # fmt: skip
OTHER_PAGES = ["http://evil.example", "http://localhost:3000", "null", "http://", "file://", "",
               "http://localhost:8080.evil.example", "http://lab-pc:3000", "https://lab.evil.example"]  # fmt: skip


async def hello(request):
    return PlainTextResponse("hello")


async def greet(websocket):
    await websocket.accept()
    await websocket.send_text("hello")
    await websocket.close()


def client(*names):
    app = Starlette(routes=[Route("/", hello, methods=["GET", "POST"]), WebSocketRoute("/ws", greet)])
    return TestClient(GuardHosts(app, frozenset(names)))


def connected(page, **headers):
    """Whether a websocket is accepted; the answer if it is not."""
    try:
        with page.websocket_connect("/ws", headers=headers) as socket:
            return socket.receive_text()
    except WebSocketDenialResponse as denied:
        return denied.status_code


@pytest.mark.parametrize("host", LOOPBACK)
def test_the_page_answers_to_the_names_of_this_machine(host):
    assert client().get("/", headers={"host": host}).status_code == 200
    assert connected(client(), host=host) == "hello"


@pytest.mark.parametrize("host", FOREIGN)
def test_it_answers_to_no_other_name(host):
    answer = client().get("/", headers={"host": host})
    assert answer.status_code == 400
    assert "hello" not in answer.text
    assert connected(client(), host=host) == 400


def test_the_refusal_says_how_to_allow_the_name():
    assert "--allow-host lab-pc" in client().get("/", headers={"host": "lab-pc:8080"}).text


def test_it_answers_to_names_that_it_was_told():
    page = client("lab-pc")
    assert page.get("/", headers={"host": "lab-pc:8080"}).status_code == 200
    assert page.get("/", headers={"host": "Lab-PC"}).status_code == 200
    assert page.get("/", headers={"host": "lab-pc.evil.example"}).status_code == 400


@pytest.mark.parametrize("hosts", [[], [b"localhost", b"evil.example"], [b"localhost", b"localhost"]])
def test_a_request_without_a_host_or_with_two_is_refused(hosts):
    sent = []
    scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", host) for host in hosts]}

    async def send(message):
        sent.append(message)

    asyncio.run(GuardHosts(PlainTextResponse("hello"))(scope, None, send))
    assert sent[0]["status"] == 400


@pytest.mark.parametrize("origin", OTHER_PAGES)
def test_another_page_cannot_use_it(origin):
    page, headers = client("lab-pc"), {"host": "localhost:8080", "origin": origin}
    assert page.post("/", headers=headers).status_code == 400
    assert page.get("/", headers=headers).status_code == 400
    assert connected(page, **headers) == 400


@pytest.mark.parametrize("host", ["lab-pc:8080", "127.0.0.1:8080"])
@pytest.mark.parametrize("origin", ["http://lab-pc", "https://lab-pc"])
def test_a_page_on_the_usual_port_of_the_same_machine_cannot_use_it(host, origin):
    assert client("lab-pc").post("/", headers={"host": host, "origin": origin}).status_code == 400
    assert connected(client("lab-pc"), host=host, origin=origin) == 400


def test_its_own_windows_can_use_it_also_behind_a_reverse_proxy_that_passes_the_host_on():
    page = client("lab-pc")
    for host, origin in (
        ("localhost:8080", "http://localhost:8080"),
        ("127.0.0.1:8080", "http://127.0.0.1:8080"),
        ("lab-pc", "https://lab-pc"),
    ):
        assert page.post("/", headers={"host": host, "origin": origin}).status_code == 200
        assert connected(page, host=host, origin=origin) == "hello"


@pytest.mark.parametrize("host", ["localhost", "evil.example"])
def test_every_answer_forbids_to_be_framed_by_another_page(host):
    answer = client().get("/", headers={"host": host})
    assert HEADERS["Content-Security-Policy"] == "frame-ancestors 'self'"
    for key, value in HEADERS.items():
        assert answer.headers[key] == value
