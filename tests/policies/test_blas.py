"""Tests of limberjack.policies.blas."""

import threading

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from limberjack.policies.blas import one_thread


def _threads() -> list[int]:
    """Those of each library of linear algebra."""
    found = ThreadpoolController().select(user_api="blas").info()
    return [library["num_threads"] for library in found]


def test_products_have_one_thread_until_the_context_ends() -> None:
    before = _threads()
    with one_thread():
        assert set(_threads()) <= {1}
        with one_thread():
            pass
        assert set(_threads()) <= {1}
    assert _threads() == before
    with pytest.raises(ZeroDivisionError), one_thread():
        raise ZeroDivisionError
    assert _threads() == before


def test_threads_take_turns() -> None:
    before, inside, most = _threads(), [0], [0]

    def multiply() -> None:
        for _ in range(50):
            with one_thread():
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                np.ones((64, 64)) @ np.ones((64, 64))
                inside[0] -= 1

    several = [threading.Thread(target=multiply) for _ in range(4)]
    for thread in several:
        thread.start()
    for thread in several:
        thread.join()
    assert most == [1]
    assert _threads() == before
