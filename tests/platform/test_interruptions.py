"""Signals: raised, held for the end of a control period, or only noted. They are real, sent by this process to itself."""

import signal
import threading

import pytest

from equipoise.platform.interruptions import Interruptions, Terminated

ALL = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture
def interruptions():
    with Interruptions() as interruptions:
        yield interruptions


@pytest.mark.parametrize("number", ALL)
def test_a_signal_raises_where_nothing_holds_it(interruptions, number):
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_other_than_ctrl_c_is_named(interruptions, number):
    with pytest.raises(Terminated, match=rf"^ended by {number.name}$") as caught:
        signal.raise_signal(number)
    assert caught.value.number == number


def held(interruptions, *acts):
    """Do things one after the other while signals are held; returns how many were done whole, and what was raised."""
    done = 0
    try:
        with interruptions.held():
            for act in acts:
                act()
                done += 1
    except BaseException as error:
        return done, type(error)
    return done, None


def ctrl_c():
    signal.raise_signal(signal.SIGINT)


def fail():
    raise ZeroDivisionError


@pytest.mark.parametrize("number", ALL)
def test_held_it_waits_for_the_next_look(interruptions, number):
    done, raised = held(interruptions, lambda: signal.raise_signal(number), interruptions.check, fail)
    assert done == 1
    assert issubclass(raised, KeyboardInterrupt)


def test_held_it_waits_for_the_end_at_most(interruptions):
    assert held(interruptions, ctrl_c) == (1, KeyboardInterrupt)
    interruptions.check()  # it was raised once, and not again


def test_held_a_second_one_does_not_wait(interruptions):
    assert held(interruptions, ctrl_c, ctrl_c, fail) == (1, KeyboardInterrupt)


def test_an_error_is_not_replaced_by_what_waits(interruptions):
    assert held(interruptions, ctrl_c, fail) == (1, ZeroDivisionError)


def test_noted_they_interrupt_nothing(interruptions):
    with interruptions.noted():
        assert not interruptions.asked
        for number in ALL:
            signal.raise_signal(number)
        assert interruptions.asked
    interruptions.check()


def test_noted_also_without_having_been_entered():
    before = [signal.getsignal(number) for number in ALL]
    interruptions = Interruptions()
    with interruptions.noted():
        for number in ALL:
            signal.raise_signal(number)
    assert interruptions.asked
    assert [signal.getsignal(number) for number in ALL] == before


def test_what_waited_when_the_ending_began_is_over_with_it(interruptions):
    held(interruptions, ctrl_c, fail)
    with interruptions.noted():
        pass
    interruptions.check()


def test_leaving_restores_what_was_there():
    before = [signal.getsignal(number) for number in ALL]
    with Interruptions():
        assert [signal.getsignal(number) for number in ALL] != before
    assert [signal.getsignal(number) for number in ALL] == before


def test_signals_that_are_ignored_stay_ignored():
    """`nohup` means that a closed terminal does not end the program."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interruptions() as interruptions:
            signal.raise_signal(signal.SIGHUP)
            with interruptions.noted():
                signal.raise_signal(signal.SIGHUP)
            assert not interruptions.asked
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_in_other_threads_nothing_is_changed():
    before, seen = [signal.getsignal(number) for number in ALL], []

    def run():
        with Interruptions() as interruptions, interruptions.held(), interruptions.noted():
            seen.extend(signal.getsignal(number) for number in ALL)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == before
