"""`allocating`: MuJoCo's objects, made so that a lack of memory is a `MemoryError` with the bytes.

    model = copy_of(shared.model)
    data = data_of(model)
    with allocating("a batch of 4096 simulations", 2**20):
        ...

MuJoCo reports a lack of memory in several ways: as `FatalError`, as `ValueError` when it compiles a
model, and as a `RuntimeError` about an unknown exception. A mapping of memory raises `OSError`.
"""

import contextlib
import copy
from collections.abc import Iterator
from pathlib import Path

import mujoco

__all__ = ["allocating", "copy_of", "data_of"]

# Parts of the messages with which MuJoCo and its bindings report that an allocation failed.
_SIGNS = ("allocate memory", "unknown exception", "bad_alloc")
_IN_USE = Path("/proc/self/status")  # of Linux


@contextlib.contextmanager
def allocating(what: str, size: int) -> Iterator[None]:
    """A context in which a lack of memory raises MemoryError.

    Args:
      what: the object to allocate, for the message.
      size: its minimum size, bytes.

    Raises:
      MemoryError: MuJoCo, or an array, could not be allocated.
    """
    try:
        yield
    except (mujoco.FatalError, ValueError, RuntimeError, OSError, MemoryError) as error:
        if not isinstance(error, MemoryError) and not any(sign in str(error) for sign in _SIGNS):
            raise
        raise MemoryError(
            f"there is no memory for {what}, {size} bytes or more{_in_use()}: close environments, "
            f"make fewer, or raise the limit of this process ({' '.join(str(error).split())})"
        ) from error


def copy_of(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a model.

    Raises:
      MemoryError: there is no memory for it.
    """
    with allocating("a copy of the model", mujoco.mj_sizeModel(model)):
        return copy.copy(model)


def data_of(model: mujoco.MjModel, like: mujoco.MjData | None = None) -> mujoco.MjData:
    """New data of a model, or a copy of other data of it.

    Raises:
      MemoryError: there is no memory for it.
    """
    with allocating("the data of a simulation", model.narena):
        return mujoco.MjData(model) if like is None else copy.copy(like)


def _in_use() -> str:
    """Part of a message: the memory that this process uses; empty if unknown."""
    with contextlib.suppress(OSError, MemoryError):
        lines = _IN_USE.read_text(encoding="utf-8").splitlines()
        sizes = [line.split()[1] for line in lines if line.startswith("VmSize:")]
        return f", and this process already has {int(sizes[0]) * 1024}"
    return ""
