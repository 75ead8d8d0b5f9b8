"""Tests of limberjack.utils.turns."""

import os
import threading

import pytest

from limberjack.utils.turns import Turn

from ..programs import run


def test_one_thread_has_the_lock_and_may_take_it_twice() -> None:
    turn, taken = Turn(), threading.Event()

    def take() -> None:
        with turn.lock:
            taken.set()

    other = threading.Thread(target=take)
    with turn.lock, turn.lock:
        other.start()
        assert not taken.wait(0.2)
    other.join()
    assert taken.is_set()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")
def test_a_child_of_a_process_whose_thread_has_the_lock_has_a_free_one() -> None:
    program = """
import os, signal, threading, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python advises against forks with threads
from limberjack.utils.turns import Turn
turn = Turn()
entered, leave = threading.Event(), threading.Event()
def hold():
    with turn.lock:
        entered.set()
        leave.wait(60)
threading.Thread(target=hold).start()
entered.wait(60)
pid = os.fork()
if pid == 0:
    signal.alarm(30)  # ends a child that waits forever
    with turn.lock:
        os._exit(7)
leave.set()
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""
    assert run(program) == "7\n"
