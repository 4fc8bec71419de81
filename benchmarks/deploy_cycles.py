"""Is the 250 Hz cycle kept? The twin's controller and the link, with both arms moving, beside what else a run does."""

from __future__ import annotations

import argparse
import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
from _report import report

from bt_jax.deploy.cell import rules_of
from bt_jax.deploy.controller import Controller
from bt_jax.deploy.link import LinkConfig, YumiLink
from bt_jax.deploy.motion import Trajectory
from bt_jax.deploy.perception import Perception
from bt_jax.deploy.rendered_camera import RenderedCamera, cell_camera
from bt_jax.deploy.twin_cell import Scene, build_scene
from bt_jax.task import load_task

SWING = 0.2  # rad of a wrist joint, to and fro
PERIOD = 1.0  # seconds of one swing
TICK = 0.1
PORTS = {"left": 26511, "right": 26512}


def swing(link: YumiLink, seconds: float) -> None:
    """Moves both arms to and fro, and shows every tick that the program is alive."""
    start = {arm: link.arm(arm).commanded for arm in link.arms}
    offset = np.array([0, 0, 0, 0, 0, SWING, 0])
    end, away = link.now() + seconds, True
    while link.now() < end:
        for arm in link.arms:
            if not link.arm(arm).moving:
                goal = start[arm] + offset * away
                link.follow(arm, Trajectory(np.array([0.0, PERIOD]), np.stack([link.arm(arm).commanded, goal])))
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


def nothing(scene: Scene, controller: Controller) -> Callable[[threading.Event], None]:
    return lambda closing: None


def perceives(scene: Scene, controller: Controller) -> Callable[[threading.Event], None]:
    def work(closing: threading.Event) -> None:
        camera = RenderedCamera(scene.model, controller.state)
        perception = Perception(scene.task, camera, cell_camera(scene.task).pose)
        while not closing.is_set():
            perception.update()
        camera.close()

    return work


def computes(scene: Scene, controller: Controller) -> Callable[[threading.Event], None]:
    def work(closing: threading.Event) -> None:
        while not closing.is_set():
            sum(range(10**5))

    return work


def measure(name: str, work, seconds: float, *, realtime: bool = True) -> dict[str, object]:
    """One row."""
    task = load_task("yumi_stack")
    scene = build_scene(task, 0)
    with Controller(scene.cell, ports=PORTS, realtime=realtime) as controller:
        config = LinkConfig("127.0.0.1", PORTS, controller.rws_port, motion=True)
        with YumiLink(config, rules_of(task), controller) as link, beside(work(scene, controller)):
            link.start()
            before, counted, began = controller.stats(), link.counters(), time.monotonic()
            swing(link, seconds)
            wall, after, link_after = time.monotonic() - began, controller.stats(), link.counters()
            stopped = link.stopped()
    cycles = after.cycles - before.cycles
    return {
        "beside": name,
        "cycles": cycles,
        "missed": after.missed - before.missed,
        "worst [ms]": round(1000 * after.worst, 2) if realtime else float("nan"),
        "without answer": after.unanswered - before.unanswered,
        "answered late": link_after.late - counted.late,
        "lost": link_after.lost - counted.lost,
        "controller [ms/cycle]": round(1000 * (after.busy - before.busy) / cycles, 3),
        "times real time": round(seconds / wall, 2),
        "stopped": stopped or "no",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement")
    seconds = parser.parse_args().seconds
    rows = [
        measure("nothing", nothing, seconds),
        measure("camera and perception", perceives, seconds),
        measure("a thread that computes", computes, seconds),
        measure("lock-step", nothing, seconds, realtime=False),
    ]
    load = " ".join(f"{x:.1f}" for x in os.getloadavg())
    report("deploy_cycles", "250 Hz, both arms", rows, seconds=seconds, load=load)


if __name__ == "__main__":
    main()
