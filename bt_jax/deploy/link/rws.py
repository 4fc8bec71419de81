"""Robot Web Services 1.0 (IRC5, RobotWare 6) as far as a cell needs them: state, start, stop, and numbers of the RAPID
program, through which the grippers are moved. Source: ABB's application manual 3HAC050973-001.

On the controller runs the RAPID module BtJax (`commands/BtJax.mod`), in each arm's task. EGM moves only the axes: the module
keeps `grip_target` and `grip_actual` (mm a finger) and `grip_force` (N), and moves the Smart Gripper. The arm stands still
and tells where it is until `egm_motion` asks for guided motion, see `Motion`.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Any

import httpx

from bt_jax._util.errors import UserError

__all__ = [
    "EGM_MOTION",
    "GRIP_ACTUAL",
    "GRIP_FORCE",
    "GRIP_TARGET",
    "MODULE",
    "TASKS",
    "ControllerState",
    "Motion",
    "Rws",
    "symbol",
]

MODULE = "BtJax"
TASKS = {"left": "T_ROB_L", "right": "T_ROB_R"}  # in which the arms run
EGM_MOTION = "egm_motion"
GRIP_TARGET, GRIP_ACTUAL, GRIP_FORCE = "grip_target", "grip_actual", "grip_force"
TIMEOUT = 2.0  # seconds a request may take
START = {
    "regain": "continue",
    "execmode": "continue",
    "cycle": "forever",
    "condition": "none",
    "stopatbp": "disabled",
    "alltaskbytsp": "false",
}


class Motion(enum.IntEnum):
    """Values of `egm_motion`: the program answers ASKED with GUIDED once an arm follows EGM."""

    LISTEN = 0
    ASKED = 1
    GUIDED = 2


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


class Rws:
    """One session with a controller. Every call raises UserError where the controller does not answer as it should."""

    def __init__(self, host: str, port: int, user: str, password: str) -> None:
        self.host, self.port = host, port
        self._client = httpx.Client(
            base_url=f"http://{host}:{port}", auth=httpx.DigestAuth(user, password), timeout=TIMEOUT, trust_env=False
        )

    def state(self) -> ControllerState:
        """Return what the controller is doing."""
        return ControllerState(
            self._get("/rw/panel/ctrlstate", "ctrlstate"),
            self._get("/rw/panel/opmode", "opmode"),
            self._get("/rw/rapid/execution", "ctrlexecstate"),
        )

    def start(self) -> None:
        """Start the RAPID program of all tasks from its beginning."""
        self._post("/rw/rapid/execution?action=resetpp", {})
        self._post("/rw/rapid/execution?action=start", START)

    def stop(self) -> None:
        """Stop the RAPID program; the robot brakes along its path."""
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

    def close(self) -> None:
        self._client.close()

    def _get(self, path: str, key: str) -> str:
        answer = self._request("GET", f"{path}?json=1", None)
        try:
            return str(answer.json()["_embedded"]["_state"][0][key])
        except (ValueError, LookupError, TypeError) as error:
            raise UserError(
                f"the controller's answer to {path} has no {key}; is {self.host} an IRC5 with RobotWare 6?"
            ) from error

    def _post(self, path: str, data: dict[str, Any]) -> None:
        self._request("POST", path, data)

    def _request(self, method: str, path: str, data: dict[str, Any] | None) -> httpx.Response:
        where = f"the controller at {self.host}:{self.port}"
        try:
            answer = self._client.request(method, path, data=data)
        except httpx.HTTPError as error:
            raise UserError(
                f"{where} cannot be reached ({error or type(error).__name__}); check cable, address and that it is on"
            ) from error
        if answer.status_code == 401:
            raise UserError(f"{where} refuses the user; give --user and --password of the controller")
        if answer.status_code >= 400:
            raise UserError(
                f"{where} refuses {path} ({answer.status_code}); put it in automatic mode, motors on, with BtJax loaded"
            )
        return answer
