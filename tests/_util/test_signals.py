import signal

import pytest

from bt_jax._util.signals import uninterrupted


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_until_what_must_be_whole_is(number):
    def handle(*_):
        raise KeyboardInterrupt

    before = signal.signal(number, handle)
    done = []

    def work():
        with uninterrupted():
            signal.raise_signal(number)
            done.append(True)

    try:
        with pytest.raises(KeyboardInterrupt):
            work()
        assert done
        assert signal.getsignal(number) is handle
    finally:
        signal.signal(number, before)


def test_an_error_inside_puts_the_handlers_back():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(ValueError, match="inside"), uninterrupted():
        raise ValueError("inside")
    assert signal.getsignal(signal.SIGINT) is before
