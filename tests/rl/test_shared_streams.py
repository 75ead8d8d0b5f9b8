"""Checks that use the global random streams wait for each other, and put the streams back."""

import concurrent.futures
import contextlib
import random
import sys
import threading

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.batches import batch_of
from limberjack.rl.control import Environment
from limberjack.rl.shared_streams import GLOBAL_STREAMS, drawn_from, fingerprint, put_back_after
from limberjack.suite import pendulum


def _states() -> tuple[str, object]:
    return repr(np.random.get_state(legacy=False)), random.getstate()


def test_streams_are_put_back_even_after_an_error() -> None:
    before = _states()

    def fail() -> None:
        np.random.seed(1)
        random.seed(1)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), put_back_after():
        fail()
    assert _states() == before


def test_the_stream_that_is_drawn_from_is_named() -> None:
    before = _states()
    assert drawn_from(GLOBAL_STREAMS, np.random.uniform) == "NumPy's global stream"
    assert drawn_from(GLOBAL_STREAMS, random.random) == "the stream of random"
    assert drawn_from(GLOBAL_STREAMS, lambda: None) is None
    assert _states() == before


def test_threads_that_use_the_streams_wait_for_each_other() -> None:
    used = threading.Event()

    def use() -> None:
        with put_back_after():
            used.set()

    other = threading.Thread(target=use)
    with put_back_after():
        other.start()
        assert not used.wait(0.2)
    other.join()
    assert used.is_set()


def test_batches_that_threads_make_at_a_time_are_not_refused_for_each_others_draws() -> None:
    interval = sys.getswitchinterval()
    before = _states()
    sys.setswitchinterval(1e-6)  # seconds; threads take turns within the check
    try:
        with concurrent.futures.ThreadPoolExecutor(4) as executor:
            made = list(executor.map(_reason, range(16)))
    finally:
        sys.setswitchinterval(interval)
    assert made == [None] * 16
    assert _states() == before


class _Own(pendulum.SwingUp):
    """Not the suite's, so it is checked."""


def _reason(seed: int) -> str | None:
    of_suite = suite.load("pendulum", "swingup")
    env = Environment(of_suite.physics, _Own(random=seed), time_limit=1)
    with contextlib.closing(batch_of(env, 2, seed=seed)) as batch:
        return batch.why_rows


def test_a_fingerprint_changes_with_every_draw_and_is_that_of_an_equal_state() -> None:
    one, other = np.random.RandomState(3), np.random.RandomState(3)
    before = fingerprint(one)
    assert before == fingerprint(other)
    one.uniform()
    assert fingerprint(one) != before
    one.seed(3)
    assert fingerprint(one) == before
    one.normal()
    assert fingerprint(one) != before
    for _ in range(312):  # 624 numbers in all: the same position, with another key
        other.uniform()
    assert fingerprint(other) != before
    of_another_kind = np.random.RandomState(np.random.PCG64(3))
    first = fingerprint(of_another_kind)
    of_another_kind.uniform()
    assert fingerprint(of_another_kind) != first
    with put_back_after():
        states = [fingerprint(np.random)]
        np.random.uniform()
        assert fingerprint(np.random) not in states
    assert fingerprint(np.random) == states[0]
