import mmap
import os
import signal
import time

import numpy as np
import pytest

from bt_jax.deploy.link.loop_timing import KEPT, NEAR, LoopTimer
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.cells import cell


def test_only_late_rounds_are_kept_with_what_was_done_before():
    timer = LoopTimer(("think", "write"))
    timer.begin(0.0)
    time.sleep(0.02)
    timer.done("think")
    timer.done("write")
    timer.end(time.monotonic() - 0.01)
    assert timer.read() == []
    timer.begin(2 * NEAR)
    (late,) = timer.read()
    assert late.late == 2 * NEAR
    assert late.slack <= -0.01
    assert late.parts["think"] > 0.019
    assert late.parts["think"] + late.parts["write"] <= late.time
    timer.begin(0.5 * NEAR)
    timer.begin(3 * NEAR)
    assert [each.late for each in timer.read()] == [2 * NEAR, 3 * NEAR]
    assert set(timer.read()[-1].parts.values()) == {0.0}, "parts are those of one round"


def test_parts_that_are_done_often_add_up():
    timer = LoopTimer(("talk",))
    timer.begin(0.0)
    for _ in range(3):
        time.sleep(0.005)
        timer.done("talk")
    timer.begin(1.0)
    assert timer.read()[0].parts["talk"] > 0.0149


def test_the_newest_are_kept():
    timer = LoopTimer(())
    for number in range(KEPT + 10):
        timer.begin(1.0 + number)
    np.testing.assert_array_equal([each.late for each in timer.read()], 1.0 + np.arange(10, KEPT + 10))


def test_page_faults_are_counted():
    timer = LoopTimer(())
    timer.begin(0.0)
    with mmap.mmap(-1, 2**24) as fresh:
        fresh[:: mmap.PAGESIZE] = bytes(2**24 // mmap.PAGESIZE)
    timer.begin(1.0)
    assert timer.read()[0].faults >= 4, "more where pages are small"


@pytest.mark.realtime
def test_a_process_that_was_kept_from_running_says_so():
    with Controller(cell(), ports=free_ports(YUMI.arm_names), realtime=True) as controller:
        time.sleep(0.3)
        began = time.monotonic()
        os.kill(controller.pid, signal.SIGSTOP)
        time.sleep(0.08)
        os.kill(controller.pid, signal.SIGCONT)
        late = 0.0
        while late <= 0.07 and time.monotonic() < began + 20:
            time.sleep(0.01)
            late = max((late.late for late in controller.late_cycles() if late.time > began), default=0.0)
        assert late > 0.07
        assert controller.stats().missed >= 17
