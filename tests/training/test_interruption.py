import os
import signal
import threading

import pytest

from bt_jax.training.interruption import Interruption


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interruption_that_python_swallows_is_raised_again():
    class Swallowing:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)
            signal.sigpending()  # let the handler run here

    with Interruption() as interruption:
        interruption.check()
        thing = Swallowing()
        del thing
        with pytest.raises(KeyboardInterrupt):
            interruption.check()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_ignored_for_a_while_and_handlers_come_back(number):
    before = signal.getsignal(number)
    with Interruption() as interruption:
        with interruption.ignored():
            os.kill(os.getpid(), number)
        interruption.check()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) == before


def test_only_the_first_signal_raises_until_the_next_is_heeded():
    with Interruption() as interruption:
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        for number in (signal.SIGINT, signal.SIGTERM):
            os.kill(os.getpid(), number)
        with interruption.ignored():
            pass
        os.kill(os.getpid(), signal.SIGINT)
        interruption.heed()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_what_was_ignored_before_still_is():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interruption() as interruption:
            os.kill(os.getpid(), signal.SIGINT)
            interruption.check()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_may_train():
    failed = []

    def train():
        try:
            with Interruption() as interruption:
                interruption.check()
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=train)
    thread.start()
    thread.join()
    assert not failed
