"""Read-only arrays and structs, whose errors say what to do instead."""

import pickle

import numpy as np
import pytest

from limberjack.mujoco.read_only import ReadOnly, ReadOnlyStruct

_ADVICE = "these are shared: use randomize"


def _made() -> tuple[np.ndarray, ReadOnly]:
    array = np.arange(6.0).reshape(2, 3)
    return array, ReadOnly.of(array, _ADVICE)


def test_every_way_of_writing_is_refused_with_the_advice() -> None:
    array, read_only = _made()
    for write in (
        lambda: read_only.__setitem__(0, 1.0),
        lambda: read_only[0].__setitem__(0, 1.0),
        lambda: read_only.__iadd__(1.0),
        lambda: np.multiply(array, 2, out=read_only),
    ):
        with pytest.raises(ValueError, match=_ADVICE):
            write()
    with pytest.raises(ValueError, match="read-only"):
        np.copyto(read_only, 0.0)
    np.testing.assert_array_equal(array, np.arange(6.0).reshape(2, 3))


def test_a_view_has_the_current_values_and_the_array_stays_writable() -> None:
    array, read_only = _made()
    array[0, 0] = 7.0
    assert read_only[0, 0] == 7.0


def test_copies_can_be_written_and_results_are_ordinary_arrays() -> None:
    _, read_only = _made()
    copied = read_only.copy()
    copied[0] = 1.0
    copied += 1.0
    assert type(read_only + 1) is type(np.sqrt(read_only)) is np.ndarray
    assert float(read_only.sum()) == 15.0
    assert pickle.loads(pickle.dumps(read_only)).tolist() == read_only.tolist()


def test_structs_refuse_attributes_and_their_arrays_elements() -> None:
    class Options:
        timestep = 0.1
        gravity = np.zeros(3)

    struct = ReadOnlyStruct(Options(), "opt")
    assert struct.timestep == 0.1
    with pytest.raises(ValueError, match=r"opt\.timestep is shared"):
        struct.timestep = 1.0
    with pytest.raises(ValueError, match=r"opt\.gravity is shared"):
        struct.gravity[0] = 1.0
