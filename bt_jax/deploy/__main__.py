"""python -m bt_jax.deploy: put a learnt tree on the robot, or on its twin."""

from __future__ import annotations

import importlib
import sys

import tyro

from bt_jax._util.errors import UserError
from bt_jax._util.startup import exit_code
from bt_jax._util.words import unknown_command
from bt_jax.deploy.commands import arguments as commands

COMMANDS = {  # name -> module, arguments, function, one line
    "twin": ("twin", "TwinArguments", "twin_command", "run a tree on the simulated YuMi"),
    "check": ("check", "CheckArguments", "check_command", "look at a real cell before anything moves"),
    "run": ("run", "RunArguments", "run_command", "run a tree on a real YuMi; dry unless told otherwise"),
    "recover": (
        "recover",
        "RecoverArguments",
        "recover_command",
        "take the arms home after a stop, whatever they hold",
    ),
    "markers": ("markers", "MarkersArguments", "markers_command", "print the markers of a task"),
    "calibrate": ("calibrate", "CalibrateArguments", "calibrate_command", "measure the camera and where it stands"),
    "rapid": ("rapid", "RapidArguments", "rapid_command", "write the program of the robot's controller"),
    "rates": ("rates", "RatesArguments", "rates_command", "estimate from logs how often what goes wrong"),
    "replay": (
        "replay",
        "ReplayArguments",
        "replay_command",
        "show a log and check that the tree decides the same again",
    ),
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        print(unknown_command(words[0], COMMANDS), file=sys.stderr)
        return 2
    if not words or words[0] not in COMMANDS:
        asked = not words or words[0] in ("-h", "--help")
        print(_usage(), file=sys.stdout if asked else sys.stderr)
        return 0 if asked and words else 2
    return _run(words[0], words[1:])


def _usage() -> str:
    lines = [f"  {name:10s} {text}" for name, (*_, text) in COMMANDS.items()]
    return "\n".join(["usage: python -m bt_jax.deploy COMMAND ... (COMMAND --help says more)", "", *lines])


def _run(name: str, words: list[str]) -> int:
    module, arguments, function, _ = COMMANDS[name]
    kind, program = getattr(commands, arguments), f"python -m bt_jax.deploy {name}"
    parsed = tyro.cli(kind, prog=program, args=words)
    code = 0

    def work() -> None:
        nonlocal code, parsed
        if isinstance(parsed, commands.TwinArguments):  # what was given counts before the preset that was given
            parsed = tyro.cli(kind, prog=program, args=words, default=parsed.with_preset())
        try:
            found = importlib.import_module(f"bt_jax.deploy.commands.{module}")
        except ModuleNotFoundError as error:
            raise UserError(f'{error.name} is not installed; run pip install -e ".[robot]"') from error
        code = getattr(found, function)(parsed)

    return exit_code(work) or code


if __name__ == "__main__":
    sys.exit(main())
