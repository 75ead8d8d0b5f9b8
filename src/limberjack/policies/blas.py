"""`one_thread`: matrix products that round alike on any number of cores.

    with one_thread():
        product = matrix @ other

NumPy's library of linear algebra (BLAS) divides a product among as many threads as there are cores,
and each division rounds in its own way. After a product its threads wait for the next one without
giving up their cores, on which the rows of a batch could be stepped: with a policy's network, two
cores then step a walker hardly faster than one.
"""

import contextlib
import functools
from collections.abc import Iterator

from threadpoolctl import ThreadpoolController

from limberjack.utils.turns import Turn

__all__ = ["one_thread"]

_turn = Turn()  # the number of threads belongs to the process


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """A context in which products are computed by the calling thread alone.

    Only one thread can be in it; others wait. Libraries that cannot be limited stay as they are.
    """
    with _turn.lock, _libraries().limit(limits=1):
        yield


@functools.cache
def _libraries() -> ThreadpoolController:
    """Those of linear algebra that this process has loaded."""
    return ThreadpoolController().select(user_api="blas")
