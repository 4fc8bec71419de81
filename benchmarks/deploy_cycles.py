"""Is the 250 Hz cycle kept, and where it is not, why? The twin's controller and the link, with both arms moving, beside what
else a run does. Meanwhile a loop that only sleeps, on each core and with more priority than ours, tells when the machine
itself gave no time: nothing that this package does can be blamed for what was late then."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks._report import report, show
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.loop_timing import LateRound
from bt_jax.deploy.link.realtime import FIFO_PRIORITY
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import TwinScene, build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.rendered_camera import RenderedCamera, cell_camera
from bt_jax.tasks import load_task

SWING = 0.2  # rad of a wrist joint, to and fro
PACE = Pace(share=0.05, acceleration=0.1)
TICK = 0.1
PORTS = {"left": 26511, "right": 26512}


def swing(link: Irc5Link, seconds: float) -> None:
    """Moves both arms to and fro, and shows every tick that the program is alive."""
    start = {arm: link.arm(arm).commanded for arm in link.arms}
    offset = np.array([0, 0, 0, 0, 0, SWING, 0])
    end, away = link.now() + seconds, True
    while link.now() < end:
        for arm in link.arms:
            if not link.arm(arm).moving:
                goal = start[arm] + offset * away
                link.follow(arm, timed(np.stack([link.arm(arm).commanded, goal]), PACE, YUMI.arm(arm)))
                away = not away if arm == link.arms[-1] else away
        link.wait(link.now() + TICK)


@contextlib.contextmanager
def beside(work: Callable[[threading.Event], None]) -> Iterator[None]:
    """Does something in a thread of this process meanwhile."""
    closing = threading.Event()
    thread = threading.Thread(target=work, args=(closing,))
    thread.start()
    try:
        yield
    finally:
        closing.set()
        thread.join()


def nothing(scene: TwinScene, controller: Controller) -> Callable[[threading.Event], None]:
    return lambda closing: None


def perceives(scene: TwinScene, controller: Controller) -> Callable[[threading.Event], None]:
    def work(closing: threading.Event) -> None:
        camera = RenderedCamera(scene.model, controller.state)
        perception = Perception(scene.task, camera, cell_camera(scene.task).pose)
        while not closing.is_set():
            perception.update()
        camera.close()

    return work


def computes(scene: TwinScene, controller: Controller) -> Callable[[threading.Event], None]:
    def work(closing: threading.Event) -> None:
        while not closing.is_set():
            sum(range(10**5))

    return work


class Machine:
    """Bare loops on every core while the context is entered; afterwards `stalls` [(when, by how much)] and `naps`."""

    def __enter__(self) -> Machine:
        words = [sys.executable, str(Path(__file__).with_name("_bare_loop.py"))]
        self._loops = [
            subprocess.Popen([*words, str(core), str(FIFO_PRIORITY + 1)], stdin=-1, stdout=-1, text=True)
            for core in sorted(os.sched_getaffinity(0))
        ]
        for process in self._loops:
            process.stdout.readline()
        self._stolen = _stolen()
        return self

    def __exit__(self, *_: object) -> None:
        self.stolen = _stolen() - self._stolen
        self.stalls, self.naps = [], 0
        for process in self._loops:
            told = json.loads(process.communicate()[0])
            self.stalls += told["stalls"]
            self.naps += told["naps"]

    def stalled(self, began: float, end: float) -> float:
        """The longest stall [s] of any core that touches the time from `began` to `end`."""
        return max((late for when, late in self.stalls if when > began and when - late < end), default=0.0)


def _stolen() -> float:
    """Seconds that the host of a virtual machine has given to others, of all cores."""
    with contextlib.suppress(OSError, ValueError), open("/proc/stat", encoding="ascii") as file:
        return int(file.readline().split()[8]) / os.sysconf("SC_CLK_TCK")
    return float("nan")


def cause(late: LateRound, machine: Machine) -> str:
    """In a word, why a round began late: the machine, if it stalled for at least half of that time."""
    if machine.stalled(late.time - late.late - CYCLE, late.time) > late.late / 2:
        return "machine stalled"
    if late.slack > 0:
        return "woken late"
    return f"long {max(late.parts, key=late.parts.get)}" + (", page faults" if late.faults > 50 else "")


def profile(kind: str, found: list[LateRound], beside: str, machine: Machine) -> list[dict[str, object]]:
    """One row for each cause."""
    causes = [cause(late, machine) for late in found]
    return [
        {
            "beside": beside,
            "process": kind,
            "cause": word,
            "over 1 ms": count,
            "over 4 ms": sum(late.late > CYCLE for late, its in zip(found, causes, strict=True) if its == word),
            "worst [ms]": round(
                1000 * max(late.late for late, its in zip(found, causes, strict=True) if its == word), 1
            ),
            "page faults": sum(late.faults for late, its in zip(found, causes, strict=True) if its == word),
            "preempted": sum(late.forced for late, its in zip(found, causes, strict=True) if its == word),
        }
        for word, count in Counter(causes).most_common()
    ]


def measure(
    name: str, work, seconds: float, *, realtime: bool = True
) -> tuple[dict[str, object], list[dict[str, object]]]:
    """One row, and the profile of what was late."""
    task = load_task("yumi_stack")
    scene, machine = build_scene(YUMI, task, 0), Machine()
    with Controller(scene.cell, ports=PORTS, realtime=realtime) as controller:
        config = link_config(YUMI, "127.0.0.1", PORTS, controller.rws_port, motion=True)
        with Irc5Link(config, cell_rules(YUMI, task), controller) as link, beside(work(scene, controller)):
            link.start()
            with machine:
                before, counted, began = controller.stats(), link.counters(), time.monotonic()
                swing(link, seconds)
                wall, after, link_after = time.monotonic() - began, controller.stats(), link.counters()
            stopped = link.stopped()
            late = [each for each in controller.late_cycles() if began < each.time < began + wall]
            rounds = [each for each in link.late_rounds() if began < each.time < began + wall]
    cycles = after.cycles - before.cycles
    row = {
        "beside": name,
        "cycles": cycles,
        "missed": after.missed - before.missed,
        "worst [ms]": round(1000 * max((each.late for each in late), default=0.0), 2) if realtime else float("nan"),
        "without answer": after.unanswered - before.unanswered,
        "answered late": link_after.late - counted.late,
        "lost": link_after.lost - counted.lost,
        "controller [ms/cycle]": round(1000 * (after.busy - before.busy) / cycles, 3),
        "times real time": round(seconds / wall, 2),
        "stopped": stopped or "no",
        "bare loops: naps": machine.naps,
        "over 4 ms late": sum(late > CYCLE for _, late in machine.stalls),
        "its worst [ms]": round(1000 * max((late for _, late in machine.stalls), default=0.0), 2),
        "stalled [s]": round(sum(late for _, late in machine.stalls), 2),
        "stolen [s]": round(machine.stolen, 2),  # by the host of a virtual machine, all cores
    }
    if not realtime:
        return row, []
    return row, profile("controller", late, name, machine) + profile("link", rounds, name, machine)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement")
    parser.add_argument("--lockstep", action="store_true", help="also the speed of lock-step, which has no deadlines")
    arguments = parser.parse_args()
    seconds = arguments.seconds
    works = [("nothing", nothing), ("camera and perception", perceives), ("a thread that computes", computes)]
    measured = [measure(name, work, seconds) for name, work in works]
    if arguments.lockstep:
        measured.append(measure("lock-step", nothing, seconds, realtime=False))
    load = " ".join(f"{x:.1f}" for x in os.getloadavg())
    profiles = [row for _, rows in measured for row in rows]
    if profiles:
        show("what was late, and why", profiles)
    report(
        "deploy_cycles", "250 Hz, both arms", [row for row, _ in measured], seconds=seconds, load=load, late=profiles
    )


if __name__ == "__main__":
    main()
