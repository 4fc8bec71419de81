"""bt-jax COMMAND ...: the same as python -m bt_jax.COMMAND ..."""

from __future__ import annotations

import importlib
import sys

from bt_jax._util.words import unknown_command

__all__ = ["main"]

COMMANDS = {  # name -> module, one line
    "train": ("train", "evolve a Behavior Tree for a task"),
    "learn": ("learn", "infer a Behavior Tree from recorded demonstrations"),
    "run": ("run", "execute a saved Behavior Tree in simulation and show it tick by tick"),
    "demonstrate": ("demonstrate", "record demonstrations in simulation, or watch a person; list, rename, delete them"),
    "check": ("check", "read files of any kind without running them, and say what is wrong"),
    "report": ("report", "write a report about a run, for a browser or a printer"),
    "app": ("app.__main__", "serve the page for people who do not program"),
    "deploy": ("deploy.__main__", "put a learnt tree on the robot, or on its twin"),
    "experiments": ("experiments.__main__", "repeat the experiments of the paper"),
}


def main() -> int:
    """Run the command that the first word names, and return its exit code."""
    words = sys.argv[1:]
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        print(unknown_command(words[0], COMMANDS), file=sys.stderr)
        return 2
    if not words or words[0] not in COMMANDS:
        asked = words[:1] in (["-h"], ["--help"])
        print(_usage(), file=sys.stdout if asked else sys.stderr)
        return 0 if asked else 2
    sys.argv = [f"bt-jax {words[0]}", *words[1:]]
    module, _ = COMMANDS[words[0]]
    return importlib.import_module(f"bt_jax.{module}").main() or 0


def _usage() -> str:
    lines = [f"  {name:12s} {text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(["usage: bt-jax COMMAND ... (bt-jax COMMAND --help says more)", "", *lines])


if __name__ == "__main__":
    sys.exit(main())
