import itertools
import os
import signal
import threading
import time

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.realtime import CONTEXT, Snapshot, may_take_priority, take_priority


class Deadly:
    """Values that kill the process that copies them."""

    def __array__(self, *_, **__):
        os.kill(os.getpid(), signal.SIGKILL)


def write_and_die(snapshot: Snapshot) -> None:
    snapshot.write(np.full(3, 1.0))
    snapshot.write(Deadly())


def tell_group(pipe) -> None:
    take_priority(realtime=False)
    pipe.send((os.getpid(), os.getpgrp()))


def test_a_signal_to_the_group_of_the_program_leaves_its_processes_to_be_ended_in_order():
    """As `timeout` and a terminal send it: the robot is stopped by a program whose link and controller are still there."""
    ours, theirs = CONTEXT.Pipe()
    process = CONTEXT.Process(target=tell_group, args=(theirs,))
    process.start()
    pid, group = ours.recv()
    process.join()
    assert pid == process.pid
    assert group == pid != os.getpgrp()


def test_a_reader_gets_what_was_written():
    snapshot = Snapshot(3)
    np.testing.assert_array_equal(snapshot.read(), np.zeros(3))
    snapshot.write(np.arange(3.0))
    np.testing.assert_array_equal(snapshot.read(), np.arange(3.0))


def test_a_writer_that_is_killed_while_it_writes_is_told():
    snapshot = Snapshot(3, patience=0.1)
    process = CONTEXT.Process(target=write_and_die, args=(snapshot,))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    found: list[str] = []

    def read():
        try:
            snapshot.read()
        except UserError as error:
            found.append(str(error))

    reader = threading.Thread(target=read, daemon=True)  # one that reads for ever must not hold up the other tests
    reader.start()
    reader.join(30.0)
    assert found, "the reader waits for ever"
    assert "start the run again" in found[0]


def test_a_reader_beside_a_writer_never_mixes_two_writes():
    snapshot, over = Snapshot(64), threading.Event()

    def write():
        number = 0.0
        while not over.is_set():
            number += 1
            snapshot.write(np.full(64, number))

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(2000):
            assert len(set(snapshot.read())) == 1
    finally:
        over.set()
        writer.join()


def test_a_reader_that_is_starved_does_not_take_a_live_writer_for_dead(monkeypatch):
    snapshot, clock = Snapshot(1, patience=1.0), itertools.count()
    view = snapshot._view()
    versions = iter([1.0, 3.0, 5.0, 7.0, 8.0])

    def write(_):
        view[0] = next(versions)

    write(None)
    monkeypatch.setattr(time, "sleep", write)
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    np.testing.assert_array_equal(snapshot.read(), np.zeros(1))


def test_asking_for_priority_changes_nothing_whatever_the_process_has():
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    if not may_take_priority():
        pytest.skip("this user may not ask for real-time priority")
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(3))
        assert may_take_priority()
        assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == (os.SCHED_RR, 3)
    finally:
        os.sched_setscheduler(0, policy, priority)
