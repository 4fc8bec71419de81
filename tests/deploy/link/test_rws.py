"""The client of Robot Web Services: sessions, the controller's refusals in words, its event log."""

import httpx
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.rws import GRIP_ACTUAL, ControllerMessage, symbol
from bt_jax.deploy.link.rws_errors import ControllerBusy, ControllerSilent, refusal
from bt_jax.deploy.twin.rws_server import PASSWORD, USER, RwsLimits
from tests.helpers.rws import client, served


def lines(server):
    return [line for _, line in server.requests]


def test_one_login_serves_all_requests_and_ends_with_a_logout():
    with served() as (_, server):
        rws = client(server)
        rws.state()
        rws.number(symbol("left", GRIP_ACTUAL))
        rws.close()
        assert [line[-3:] for line in lines(server)].count("401") == 1, "the first request alone is challenged"
        assert lines(server)[-1] == "GET /logout 200"


def test_sessions_are_given_back_by_the_logout():
    with served(RwsLimits(sessions=1)) as (_, server):
        for _ in range(3):
            rws = client(server, back_off=())
            rws.state()
            with pytest.raises(ControllerBusy):
                client(server, back_off=()).state()
            rws.close()


def test_an_expired_session_is_begun_again():
    with served(RwsLimits(idle=-1.0)) as (_, server):
        rws = client(server)
        for _ in range(3):
            assert rws.execution() == "running"
        rws.close()


def test_a_controller_that_was_restarted_is_logged_in_to_again():
    with served() as (_, server):
        rws = client(server)
        rws.execution()
        state = server.RequestHandlerClass.state
        state.nonce, state._sessions = "other", {}
        assert rws.execution() == "running"


def test_a_busy_controller_is_asked_again_later_and_then_called_busy():
    with served(RwsLimits(rate=4.0)) as (_, server):
        rws = client(server, back_off=(0.2, 1.1))
        for _ in range(6):
            rws.execution()
        assert "503" in " ".join(lines(server))
        hasty = client(server, back_off=())
        with pytest.raises(ControllerBusy, match="busy"):
            [hasty.execution() for _ in range(6)]


def test_a_controller_that_hangs_is_silent():
    with served() as (controller, server):
        controller.hang = 5.0
        with pytest.raises(ControllerSilent, match="does not answer"):
            client(server, timeout=0.2).number(symbol("left", GRIP_ACTUAL))


@pytest.mark.parametrize(
    ("path", "status", "code", "words"),
    [
        (
            "/rw/rapid/symbol/data/RAPID/T_ROB_L/BtJax/grip_actual",
            404,
            None,
            ["BtJax is not loaded", "T_ROB_L", "rapid"],
        ),
        ("/rw/rapid/symbol/data/RAPID/T_ROB_R/BtJax/x?action=set", 400, -1073414146, ["T_ROB_R", "has no x of module"]),
        ("/rw/elsewhere", 404, -1073414146, ["does not know /rw/elsewhere"]),
        ("/rw/rapid/execution?action=start", 403, -1073445862, ["mastership", "RobotStudio"]),
        ("/rw/rapid/execution?action=start", 403, -1073445881, ["mode", "rights"]),
        ("/rw/rapid/execution?action=start", 400, -1073442809, ["acknowledge", "PP to main"]),
        ("/rw/panel/opmode", 401, None, ["--user"]),
        ("/rw/panel/opmode", 503, None, ["busy", "close other programs"]),
        ("/rw/panel/opmode", 500, None, ["event log"]),
    ],
)
def test_each_refusal_has_a_remedy_of_its_own(path, status, code, words):
    said = str(refusal("the controller", path, status, code))
    for word in words:
        assert word in said
    assert ("automatic mode" in said) == ("execution" in path and code in (-1073445881, -1073442809))


def test_refusals_of_the_twin_are_understood():
    with served() as (controller, server):
        rws = client(server)
        with pytest.raises(UserError, match="BtJax is not loaded"):
            rws.number("RAPID/T_ROB_L/BtJax/nothing")
        with pytest.raises(UserError, match="has no nothing of module BtJax in task T_ROB_R"):
            rws.set_number("RAPID/T_ROB_R/BtJax/nothing", 1.0)
        controller.rapid, controller.control = False, "motoroff"
        with pytest.raises(UserError, match="motors on"):
            rws.start()
        with pytest.raises(UserError, match="refuses the user"):
            client(server, password="guess").state()


def test_messages_come_newest_first():
    with served() as (controller, server):
        controller.messages.append(ControllerMessage(2, 3, 50204, "Motion supervision"))
        newest, older = client(server).messages()
        assert str(newest) == "50204 Motion supervision"
        assert (newest.kind, older.number) == (3, 1)


def test_the_server_wants_a_form_and_tells_the_cycle():
    with served() as (_, server):
        address = f"http://127.0.0.1:{server.server_address[1]}"
        with httpx.Client(base_url=address, auth=httpx.DigestAuth(USER, PASSWORD), trust_env=False) as foreign:
            told = foreign.get("/rw/rapid/execution?json=1").json()["_embedded"]["_state"][0]
            assert told == {"ctrlexecstate": "running", "cycle": "forever"}
            assert {"-http-session-", "ABBCX"} <= set(foreign.cookies)
            stop = "/rw/rapid/execution?action=stop"
            assert foreign.post(stop, json={"stopmode": "stop"}).status_code == 415
            assert foreign.post(stop, data={"stopmode": "sometime"}).status_code == 400
            assert foreign.post(stop, data={"stopmode": "stop"}).status_code == 204
            assert foreign.get("/logout").status_code == 200
