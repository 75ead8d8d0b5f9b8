"""Interpreter exit while threads simulate."""

import threading

from limberjack.mujoco import leaving
from tests.programs import run


def test_a_call_is_marked_with_its_thread() -> None:
    busy = leaving.Busy()
    leaving.begin(busy)
    assert busy.busy_in == threading.get_ident()


_PROGRAM = """
    import threading, time
    from limberjack.mujoco import leaving

    class Call(leaving.Busy):
        pass

    call, entered = Call(), threading.Event()
    leaving.watch(call)

    def simulate():
        leaving.begin(call)
        entered.set()
        time.sleep({seconds})
        print("the call has ended", flush=True)
        call.busy_in = None
        leaving.begin(call)
        print("another call has begun", flush=True)

    threading.Thread(target=simulate, daemon=True).start()
    entered.wait()
    print("the program ends", flush=True)
"""


def test_the_exit_waits_for_a_daemons_call_and_lets_it_begin_no_other() -> None:
    lines = run(_PROGRAM.format(seconds=0.3)).splitlines()
    assert lines == ["the program ends", "the call has ended"]


def test_the_exit_waits_no_longer_than_two_seconds() -> None:
    assert run(_PROGRAM.format(seconds=60)).splitlines() == ["the program ends"]


def test_a_call_that_ctrl_c_cut_short_in_the_main_thread_is_not_waited_for() -> None:
    program = """
        import time
        from limberjack.mujoco import leaving
        call = leaving.Busy()
        leaving.watch(call)
        leaving.begin(call)  # and never set back
        began = time.monotonic()
        leaving._wait_for_calls()
        print(time.monotonic() - began < leaving._LONGEST_WAIT)
    """
    assert run(program) == "True\n"


def test_at_exit_the_main_thread_may_still_begin_a_call() -> None:
    program = """
        import atexit

        def last():
            from limberjack.mujoco import leaving
            leaving.begin(leaving.Busy())
            print("begun")

        atexit.register(last)
        from limberjack.mujoco import leaving  # whose own part of the exit comes before
    """
    assert run(program) == "begun\n"
