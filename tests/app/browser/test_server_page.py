"""Who may open the page, and that no address leads to other files."""

import http.client
import socket

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.slow


def test_it_listens_on_one_loopback_address_only(server):
    socket.create_connection(("127.0.0.1", server.port), timeout=60).close()
    with pytest.raises(ConnectionRefusedError):  # whoever listens everywhere listens here as well
        socket.create_connection(("127.0.0.2", server.port), timeout=60).close()


@pytest.mark.parametrize(
    "path",
    ["/runs", "/config.json", "/../secret.txt", "/%2e%2e/secret.txt", "/_nicegui/../../secret.txt", "/..%2fsecret.txt",
     "//etc/passwd", "/etc/passwd", "/_nicegui/static/..%2f..%2f..%2f..%2f..%2fetc%2fpasswd"],
)  # fmt: skip
def test_no_address_leads_to_files(server, path):
    (server.folder.parent / "secret.txt").write_text("root: a secret\n")
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("GET", path)
    answer = connection.getresponse()
    assert answer.status >= 400
    assert b"root:" not in answer.read()


POLLING = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
WEBSOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.mark.parametrize(("path", "more", "good"), [("/", {}, 200), (POLLING, {}, 200), (WEBSOCKET, UPGRADE, 101)])
def test_another_page_cannot_use_it(server, path, more, good):
    own = f"127.0.0.1:{server.port}"

    def status(**headers):
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
        connection.request("GET", path, headers={**more, **headers})
        answer = connection.getresponse()
        connection.close()
        return answer.status

    assert status(Host=own) == good
    assert status(Host=f"localhost:{server.port}", Origin=f"http://localhost:{server.port}") == good
    assert status(Host=f"rebound.example:{server.port}") == 400
    assert status(Host=own, Origin="http://evil.example") == 400
    assert status(Host=own, Origin=f"http://127.0.0.1:{server.port + 1}") == 400
    assert status(Host=own, Origin="null") == 400


def test_an_unknown_step_shows_the_first(server, page, see):
    for step in ("nowhere", "../../etc", "<script>alert(1)</script>", ""):
        page.goto(f"{server.url}/?step={step}")
        expect(see("panel-task"), step).to_be_visible()
