"""Checks that use the global random streams wait for each other, and put the streams back."""

import concurrent.futures
import contextlib
import random
import sys

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.batches import batch_of
from limberjack.rl.control import Environment
from limberjack.rl.shared_streams import GLOBAL_STREAMS, drawn_from, put_back_after
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
