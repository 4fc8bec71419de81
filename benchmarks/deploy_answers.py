"""What one message of the controller costs the link, which has 4 ms for those of both arms: hear it, decide, supervise.
No socket and no other process: the code that decides, on one core, with the clearance of the packaged cell."""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks._report import report
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.guidance import Guidance
from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task

SWING = np.array([0, 0, 0, 0, 0, 0.3, 0])
PACE = Pace(share=0.05, acceleration=0.1)


class Messages:
    """Sends both arms' messages, each arm measured where it was sent last, and takes the processor time of each answer."""

    def __init__(self) -> None:
        self.guidance = Guidance(cell_rules(YUMI, load_task("yumi_stack")), YUMI.arm_names, realtime=True)
        self.where = {arm: joints.copy() for arm, joints in YUMI.home.items()}
        self.number = 0
        self.guidance.begin_answering()
        self.cycle()
        self.cycle()
        self.cycle()
        assert self.guidance.enable(self.number * CYCLE) is None

    def cycle(self) -> list[float]:
        """Seconds that the message of each arm took."""
        self.number += 1
        now, took = self.number * CYCLE, []
        for arm in YUMI.arm_names:
            joints = self.where[arm]
            message = Feedback(self.number, now, joints, joints, True, Mci.RUNNING, True).encode()
            began = time.thread_time()
            self.guidance.hear(arm, Feedback.decode(message, len(joints)), now)
            sent = self.guidance.answer(arm, now)
            self.guidance.watch(now, now)
            took.append(time.thread_time() - began)
            self.where[arm] = joints if sent is None else sent
        return took

    def swing(self) -> None:
        """Starts a path of each arm that rests."""
        for arm in YUMI.arms:
            if not self.guidance.arms[arm.name].moving:
                start = self.where[arm.name]
                goal = np.array(arm.home) + (SWING if np.allclose(start, arm.home) else 0)
                path = timed(np.stack([start, goal]), PACE, arm)
                assert self.guidance.follow(arm.name, path.times, path.joints, self.number) is None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=5000)
    cycles = parser.parse_args().cycles
    rows = []
    for name, moving in (("both arms rest", False), ("both arms move", True)):
        messages, took = Messages(), []
        for _ in range(cycles):
            if moving:
                messages.swing()
            took += messages.cycle()
        assert messages.guidance.supervisor.reason is None, messages.guidance.supervisor.reason
        microseconds = 1e6 * np.array(took)
        rows.append(
            {
                "while": name,
                "messages": len(took),
                "median [us]": round(float(np.median(microseconds))),
                "99 % [us]": round(float(np.percentile(microseconds, 99))),
                "both arms, share of the cycle": round(float(2e-6 * np.median(microseconds) / CYCLE), 3),
            }
        )
    report("deploy_answers", "answers of the link, per message", rows)


if __name__ == "__main__":
    main()
