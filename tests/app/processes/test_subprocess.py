"""Commands beside the page: a few at once, whoever presses what how often."""

import asyncio

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.processes import subprocess
from bt_jax.app.processes.subprocess import AT_ONCE, run_command

SLEEPS = """
import time
try:
    print("begun")
    time.sleep(600)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_a_flood_starts_a_few_processes_and_refuses_the_others(monkeypatch):
    started = []
    create = asyncio.create_subprocess_exec

    async def counted(*words, **more):
        started.append(words)
        return await create(*words, **more)

    async def flood():
        return await asyncio.gather(*(run_command("this", [], otherwise="") for _ in range(60)), return_exceptions=True)

    monkeypatch.setattr(subprocess.asyncio, "create_subprocess_exec", counted)
    refused = [error for error in asyncio.run(flood()) if error is not None]
    assert len(started) == AT_ONCE
    assert len(refused) == 60 - AT_ONCE
    assert all(isinstance(error, UserError) and "wait until one is done" in str(error) for error in refused)
    assert asyncio.run(run_command("this", [], otherwise="")) is None  # the others have ended


def test_what_fails_makes_room_too():
    for _ in range(AT_ONCE + 1):
        with pytest.raises(UserError, match="No module named"):
            asyncio.run(run_command("no_such_module", [], otherwise=""))


def test_what_it_prints_is_heard_and_it_ends_as_by_control_c():
    async def watch():
        heard, interrupt = [], asyncio.Event()

        def hear(line):
            heard.append(line)
            interrupt.set()

        await run_command(
            "timeit", ["-n", "1", "-r", "1", "-s", SLEEPS, "pass"], otherwise="", say=hear, interrupt=interrupt
        )
        return heard

    assert asyncio.run(watch())[:2] == ["begun", "interrupted"]
