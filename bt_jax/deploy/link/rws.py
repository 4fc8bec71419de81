"""Robot Web Services 1.0 (IRC5, RobotWare 6) as far as a cell needs them: state, start, stop, messages, and numbers of the
RAPID program, through which the grippers are moved.

Sources: ABB's application manual 3HAC050973-001 (developercenter.robotstudio.com/api/rwsApi), and two public clients that
are used with an IRC5: ros-industrial/abb_librws (C++) and rpiRobotics/abb_robot_client (Python). Like them, we ask for no
mastership: in automatic mode the controller takes it itself for the time of a start, a stop or a write. A session is a pair
of cookies (-http-session-, ABBCX) that comes with the first answer; a controller has few of them, so that we log out.

On the controller runs the RAPID module BtJax (`commands/BtJax.mod`), in each arm's task. EGM moves only the axes: the module
keeps `grip_target` and `grip_actual` (mm a finger) and `grip_force` (N), and moves the Smart Gripper. The arm stands still
and tells where it is until `egm_request` asks for guided motion, and tells in `egm_state` what it does: each is written by
one side only, so that no request is lost while another is carried out. `egm_here` lets it begin away from its ready target.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import math
import time
from typing import Any

import httpx

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.request_budget import RequestBudget
from bt_jax.deploy.link.rws_errors import ControllerBusy, ControllerSilent, refusal

__all__ = [
    "EGM_HERE",
    "EGM_REQUEST",
    "EGM_STATE",
    "GRIP_ACTUAL",
    "GRIP_FORCE",
    "GRIP_TARGET",
    "MODULE",
    "TASKS",
    "ControllerMessage",
    "ControllerState",
    "Motion",
    "Rws",
    "symbol",
]

MODULE = "BtJax"
TASKS = {"left": "T_ROB_L", "right": "T_ROB_R", "arm": "T_ROB1"}  # in which the arms run; a single one is "arm"
EGM_REQUEST, EGM_STATE, EGM_HERE = "egm_request", "egm_state", "egm_here"
GRIP_TARGET, GRIP_ACTUAL, GRIP_FORCE = "grip_target", "grip_actual", "grip_force"
TIMEOUT = 2.0  # seconds a request may take
BACK_OFF = (0.2, 0.4)  # seconds to wait before each further try where the controller is busy
START = {
    "regain": "continue",
    "execmode": "continue",
    "cycle": "forever",
    "condition": "none",
    "stopatbp": "disabled",
    "alltaskbytsp": "false",
}


class Motion(enum.IntEnum):
    """Values of `egm_request` and `egm_state`."""

    LISTEN = 0
    GUIDED = 1  # by EGM


def symbol(arm: str, name: str) -> str:
    """Return the address of a number of the RAPID program."""
    return f"RAPID/{TASKS[arm]}/{MODULE}/{name}"


@dataclasses.dataclass(frozen=True)
class ControllerState:
    """`control`: motoron, motoroff, guardstop, emergencystop ...; `mode`: AUTO, MANR, MANF; `rapid`: running, stopped."""

    control: str
    mode: str
    rapid: str

    @property
    def ready(self) -> bool:
        """Could the RAPID program be started now?"""
        return self.control == "motoron" and self.mode == "AUTO"


@dataclasses.dataclass(frozen=True)
class ControllerMessage:
    """A line of the controller's event log."""

    number: int  # counts up
    kind: int  # 1 for information, 2 for a warning, 3 for an error
    code: int  # ABB's: 50204 is "motion supervision"
    title: str
    description: str = ""
    time: str = ""  # by the controller's clock: 2026-09-25 T 22:15:06

    def __str__(self) -> str:
        return f"{self.code} {self.title}"


class Rws:
    """One session with a controller. Every call raises UserError where the controller does not answer as it should:
    ControllerSilent where it does not answer, ControllerBusy where it answers 503 for longer than `back_off` [s].

    A session that has expired is begun again. Requests take their turns of `budget`, commands first.
    """

    def __init__(
        self,
        host: str,
        port: int,
        user: str,
        password: str,
        *,
        budget: RequestBudget | None = None,
        timeout: float = TIMEOUT,
        back_off: tuple[float, ...] = BACK_OFF,
    ) -> None:
        self.host, self.port = host, port
        self._budget = RequestBudget(None) if budget is None else budget
        self._user, self._back_off = (user, password), back_off
        self._logged_in = False
        self._client = httpx.Client(
            base_url=f"http://{host}:{port}",
            auth=httpx.DigestAuth(user, password),
            timeout=timeout,
            trust_env=False,
            event_hooks={"request": [lambda _: self._budget.count()]},
        )

    def state(self) -> ControllerState:
        """Return what the controller is doing."""
        return ControllerState(
            self._get("/rw/panel/ctrlstate", "ctrlstate"), self._get("/rw/panel/opmode", "opmode"), self.execution()
        )

    def execution(self) -> str:
        """Return whether RAPID is running or stopped."""
        return self._get("/rw/rapid/execution", "ctrlexecstate")

    def start(self) -> None:
        """Start the RAPID program of all tasks from its beginning."""
        self._post("/rw/rapid/execution?action=resetpp", {})
        self._post("/rw/rapid/execution?action=start", START)

    def stop(self) -> None:
        """Ask for a stop of the RAPID program; the robot brakes along its path. See `execution` for whether it did."""
        self._post("/rw/rapid/execution?action=stop", {"stopmode": "stop", "usetsp": "normal"})

    def number(self, url: str) -> float:
        """Return a RAPID number, see `symbol`."""
        text = self._get(f"/rw/rapid/symbol/data/{url}", "value")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise UserError(f"{url} on the controller is '{text}' and no number; load BtJax again")
        return value

    def set_number(self, url: str, value: float) -> None:
        """Write a RAPID number."""
        self._post(f"/rw/rapid/symbol/data/{url}?action=set", {"value": f"{value:.4f}"})

    def messages(self) -> list[ControllerMessage]:
        """Return the last lines of the controller's event log, the newest first."""
        path = "/rw/elog/0?lang=en&order=lifo&limit=10"
        found = self._states(path)
        try:
            messages = [
                ControllerMessage(
                    number=int(str(each["_title"]).rpartition("/")[2]),
                    kind=int(each["msgtype"]),
                    code=int(each["code"]),
                    title=str(each["title"]),
                    description=str(each.get("desc", "")),
                    time=str(each.get("tstamp", "")),
                )
                for each in found
            ]
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise self._strange(path, "messages") from error
        return sorted(messages, key=lambda message: message.number, reverse=True)

    def close(self) -> None:
        """Log out, as far as the controller answers, and close the connection."""
        if self._logged_in and not self._client.is_closed:
            with contextlib.suppress(UserError, httpx.HTTPError):
                self._client.get("/logout", timeout=min(TIMEOUT, 0.5))
        self._client.close()

    def _get(self, path: str, key: str) -> str:
        try:
            return str(self._states(path)[0][key])
        except (LookupError, TypeError) as error:
            raise self._strange(path, key) from error

    def _states(self, path: str) -> list[dict[str, Any]]:
        answer = self._request("GET", path, None)
        try:
            found = answer.json()["_embedded"]["_state"]
        except (ValueError, LookupError, TypeError) as error:
            raise self._strange(path, "state") from error
        if not isinstance(found, list):
            raise self._strange(path, "state")
        return found

    def _strange(self, path: str, key: str) -> UserError:
        return UserError(f"the controller's answer to {path} has no {key}; is {self.host} an IRC5 with RobotWare 6?")

    def _post(self, path: str, data: dict[str, Any]) -> None:
        self._request("POST", path, data)

    def _request(self, method: str, path: str, data: dict[str, Any] | None) -> httpx.Response:
        """Send a request and return its answer; wait where the controller is busy, and log in again where it forgot us."""
        with self._budget.turn(command=method == "POST"):
            for pause in (*self._back_off, None):
                answer = self._send(method, path, data)
                if answer.status_code == 401 and self._logged_in:
                    self._client.cookies.clear()
                    self._client.auth = httpx.DigestAuth(*self._user)
                    answer = self._send(method, path, data)
                self._logged_in = self._logged_in or answer.status_code < 400
                if answer.status_code < 400:
                    return answer
                problem = refusal(f"the controller at {self.host}:{self.port}", path, answer.status_code, _code(answer))
                if pause is None or not isinstance(problem, ControllerBusy):
                    raise problem
                time.sleep(pause)
        raise AssertionError("the last try returns or raises")

    def _send(self, method: str, path: str, data: dict[str, Any] | None) -> httpx.Response:
        try:
            return self._client.request(method, f"{path}{'&' if '?' in path else '?'}json=1", data=data)
        except httpx.HTTPError as error:
            where = f"the controller at {self.host}:{self.port}"
            if isinstance(error, httpx.ReadTimeout | httpx.WriteTimeout):
                raise ControllerSilent(f"{where} does not answer; check that it is not being restarted") from error
            raise ControllerSilent(
                f"{where} cannot be reached ({error or type(error).__name__}); check cable, address and that it is on"
            ) from error


def _code(answer: httpx.Response) -> int | None:
    """Return ABB's return code in an answer, None if it has none."""
    try:
        return int(answer.json()["_embedded"]["status"]["code"])
    except (ValueError, LookupError, TypeError):
        return None
