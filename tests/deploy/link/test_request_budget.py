"""No second sees too many requests, and a command waits for no reading."""

import threading
import time

from bt_jax.deploy.link.request_budget import RequestBudget


def test_no_second_sees_more_than_its_share():
    budget, sent = RequestBudget(10), []

    def ask(command):
        for _ in range(6):
            with budget.turn(command=command):
                budget.count()
                sent.append(time.monotonic())

    threads = [threading.Thread(target=ask, args=(command,)) for command in (False, True, False)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(sent) == 18
    assert all(sum(start <= each < start + 0.99 for each in sent) <= 10 for start in sent)


def test_a_command_goes_before_readings_that_wait():
    budget, order, begun = RequestBudget(20), [], threading.Event()

    def ask(name, command):
        begun.set()
        with budget.turn(command=command):
            budget.count()
            order.append(name)

    with budget.turn():
        budget.count()
        threads = [
            threading.Thread(target=ask, args=(name, name == "command")) for name in ("first", "second", "command")
        ]
        for thread in threads:
            begun.clear()
            thread.start()
            begun.wait()
            time.sleep(0.02)
    for thread in threads:
        thread.join()
    assert order[0] == "command"
