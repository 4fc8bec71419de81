"""What a controller's refusal means, and what helps.

The status alone says little: ABB's return code in the answer tells a symbol that is not there from a mastership that is
missing. Codes: "Robot controller return codes" of ABB's manual 3HAC050973-001
(developercenter.robotstudio.com/api/rwsApi/common_return_codes.html). 503 is what an IRC5 answers when it has too much to do
(abb_robot_client calls it "too many active connections").
"""

from __future__ import annotations

from bt_jax._util.errors import UserError

__all__ = ["ControllerBusy", "ControllerSilent", "refusal"]

NOT_FOUND = -1073414146  # SYS_CTRL_E_FAIL: with 404, and with 400, where a symbol or a module is not there
HELD = (-1073445862, -1073445859)  # mastership: of somebody else; missing
REJECTED = -1073445881  # the user has no grant for it, or the mode does not allow it
WRONG_STATE = -1073442809  # RAPID cannot be started as things are
SYMBOLS = "/rw/rapid/symbol/data/RAPID/"


class ControllerBusy(UserError):
    """The controller has too much to do, and will answer later."""


class ControllerSilent(UserError):
    """The controller cannot be reached, or does not answer in time."""


def refusal(where: str, path: str, status: int, code: int | None) -> UserError:
    """Return the error for a request that was answered with `status` (400 or above) and ABB's return code."""
    answer = f"{status}" if code is None else f"{status}, code {code}"
    if status == 503:
        return ControllerBusy(
            f"{where} is busy ({answer}): it gets too many requests, or has too many sessions; close other programs that "
            "talk to it (RobotStudio, dashboards), and try again"
        )
    if status == 401:
        return UserError(f"{where} refuses the user; give --user and --password of the controller")
    if status == 404 or (status == 400 and code == NOT_FOUND):
        return UserError(f"{where} {_missing(path, answer)}")
    if status == 403 or code in (*HELD, REJECTED):
        return UserError(f"{where} {_forbidden(path, answer, code)}")
    if path.startswith("/rw/rapid/execution"):
        return UserError(
            f"{where} does not do {path} as things are ({answer}); acknowledge errors on the pendant, choose automatic "
            "mode, motors on, and PP to main in both tasks"
        )
    return UserError(f"{where} refuses {path} ({answer}); read its event log on the pendant")


def _missing(path: str, answer: str) -> str:
    if not path.startswith(SYMBOLS):
        return f"does not know {path} ({answer}); is it an IRC5 with RobotWare 6?"
    task, module, *name = path.removeprefix(SYMBOLS).partition("?")[0].split("/")
    return (
        f"has no {'/'.join(name)} of module {module} in task {task} ({answer}): {module} is not loaded there, or is of "
        f"another version; write it with python -m bt_jax.deploy rapid and load it into {task}"
    )


def _forbidden(path: str, answer: str, code: int | None) -> str:
    if code in HELD:
        return (
            f"does not let us do {path} ({answer}): another program holds mastership; release the write access of "
            "RobotStudio, or of whatever program has it"
        )
    return (
        f"does not let us do {path} ({answer}): neither its mode nor this user's rights allow it; choose automatic mode, or "
        "a user with remote start, stop and RAPID write access"
    )
