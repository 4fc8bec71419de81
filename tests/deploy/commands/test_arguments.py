"""What the commands take: no number that cannot be gets past `check`, and no recording is the eyes of a robot that moves."""

import dataclasses
import math
import typing
from pathlib import Path

import pytest
import tyro

from bt_jax._util.errors import UserError
from bt_jax.commands.arguments import DemonstrateArguments
from bt_jax.deploy.commands import arguments
from bt_jax.deploy.commands.arguments import (
    DEFAULT_TASK,
    CalibrateArguments,
    CheckArguments,
    RapidArguments,
    RecoverArguments,
    RunArguments,
    TwinArguments,
)
from bt_jax.deploy.twin.settings import Realism

TREE = Path("tree.txt")
COMMANDS = {
    CheckArguments: {"source": TREE},
    RunArguments: {"source": TREE},
    RecoverArguments: {"source": TREE},
    TwinArguments: {"source": TREE},
    CalibrateArguments: {"step": "intrinsics"},
    RapidArguments: {},
}
UNLIMITED = {"rate", "egm_speed", "requests", "contact", "finger_speed"}  # of Realism: inf is no limit
ANY_SIGN = {"exposure", "camera_moved", "camera_turned"}  # offsets


def numbers(kind, known):
    """The options of a command that are numbers: name and whether it is a whole one."""
    hints = typing.get_type_hints(kind, vars(arguments))
    for field in dataclasses.fields(kind):
        types = {hints[field.name], *typing.get_args(hints[field.name])}
        if types & {int, float} and field.name not in known:
            yield field.name, float in types, tuple in {typing.get_origin(each) for each in types}


CASES = [
    (kind, name, value if not pair else (value, 6512))
    for kind, known in COMMANDS.items()
    for name, fraction, pair in numbers(kind, known)
    for value in ([math.nan, math.inf, -1.0] if fraction else [-1])
]


@pytest.mark.parametrize(("kind", "name", "value"), CASES)
def test_a_number_that_cannot_be_is_refused_in_one_sentence(kind, name, value):
    kind(**COMMANDS[kind]).check()
    given = kind(**COMMANDS[kind] | {name: value})
    with pytest.raises(UserError) as refused:
        (given.with_preset() if name == "worse" else given).check()
    said = str(refused.value)
    assert f"--{name.replace('_', '-')}" in said
    assert "\n" not in said
    assert not said.endswith(".")


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Realism)])
def test_a_cell_that_cannot_be_is_refused(name):
    usual = getattr(Realism(), name)
    for value in (-1,) if isinstance(usual, int) else (math.nan, math.inf, -1.0):
        if (value == math.inf and name in UNLIMITED) or (value == -1 and name in ANY_SIGN):
            continue
        with pytest.raises(UserError, match=name if name not in ("width", "height") else "pixels"):
            Realism(**{name: (value, 0.0, 0.0) if isinstance(usual, tuple) else value}).check()


@pytest.mark.parametrize("kind", [CheckArguments, RunArguments, RecoverArguments, TwinArguments, DemonstrateArguments])
def test_help_names_the_task_that_is_taken(kind, capsys):
    with pytest.raises(SystemExit):
        tyro.cli(kind, args=["--help"])
    assert f"{DEFAULT_TASK})" in capsys.readouterr().out.replace("\n", " ")


@pytest.mark.parametrize("kind", [CheckArguments, RunArguments, RecoverArguments, TwinArguments])
def test_each_arm_has_a_port_of_its_own(kind):
    with pytest.raises(UserError, match="--ports names 6511 twice"):
        kind(TREE, ports=(6511, 6511)).check()


def test_no_recording_is_the_eyes_of_a_robot_that_moves(tmp_path):
    film = tmp_path / "film.mp4"
    film.write_bytes(b"")
    for recording in map(str, (tmp_path, film)):
        for moving, remedy in ((RunArguments(TREE, motion=True), "--motion"), (RecoverArguments(TREE), "--camera")):
            with pytest.raises(UserError, match=f"recording.*leave out {remedy}"):
                dataclasses.replace(moving, camera=recording).check()
        for still in (RunArguments(TREE), CheckArguments(TREE)):
            dataclasses.replace(still, camera=recording).check()
    for camera in ("0", "rtsp://10.0.0.2/stream", "/dev/null"):
        for moving in (RunArguments(TREE, motion=True), RecoverArguments(TREE)):
            dataclasses.replace(moving, camera=camera).check()
