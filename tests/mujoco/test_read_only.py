"""Read-only arrays and structs, whose errors say what to do instead."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack.mujoco.read_only import Checked, ReadOnly, ReadOnlyStruct

_ADVICE = "these are shared: use randomize"


def _made() -> tuple[np.ndarray, ReadOnly]:
    array = np.arange(6.0).reshape(2, 3)
    return array, ReadOnly.of(array, _ADVICE)


_WRITES: dict[str, Callable[[Any], object]] = {
    "item": lambda a: a.__setitem__((0, 1), 9),
    "part": lambda a: a[1].__setitem__(slice(None), [7, 8, 9]),
    "reversed": lambda a: a[::-1, ::-1].__setitem__((0, 0), 77),
    "mask": lambda a: a.__setitem__(a > 2, 5),
    "list": lambda a: a.__setitem__(([0, 1], [1, 2]), 5),
    "bytes": lambda a: a.view(np.uint8).__setitem__((0, 0), 200),
    "fill": lambda a: a.T.fill(3),
    "put": lambda a: a.put([0, 5], [11, 12]),
    "sort": lambda a: a.reshape(-1)[::-1].sort(),
    "partition": lambda a: a[:, ::-1].partition(1),
    "setfield": lambda a: a.setfield(1, np.int8),
    "byteswap": lambda a: a.byteswap(inplace=True),
    "flat": lambda a: a.flat.__setitem__(3, 99),
    "all flat": lambda a: setattr(a, "flat", [5, 6]),
    "np.put": lambda a: np.put(a, [1], [3]),
    "np.copyto": lambda a: np.copyto(a, 4),
    "np.copyto by name": lambda a: np.copyto(dst=a, src=5),
    "np.place": lambda a: np.place(a, a > 2, [0]),
    "np.putmask": lambda a: np.putmask(a, a > 2, 7),
    "np.fill_diagonal": lambda a: np.fill_diagonal(a, 8),
    "np.put_along_axis": lambda a: np.put_along_axis(a, np.array([[0], [1]]), 9, 1),
    "iadd": lambda a: a.__iadd__(1),
    "out": lambda a: np.add(a, 1, out=a),
    "one of two outs": lambda a: np.divmod(a, 2, out=(a, np.zeros((2, 3), np.int32))),
    "at": lambda a: np.add.at(a, (0, 0), 5),
    "accumulate": lambda a: np.add.accumulate(a, axis=1, out=a),
    "clip": lambda a: np.clip(a, 1, 2, out=a),
    "take": lambda a: np.take([3, 4, 5, 6, 7, 8, 9], a, out=a),
}
# NumPy writes these to the memory itself, without asking the array's class.
_REFUSED_BY_NUMPY: dict[str, Callable[[Any], object]] = {
    "base class": lambda a: np.asarray(a).__setitem__(0, 1),
    "shuffle": lambda a: np.random.default_rng(0).shuffle(a),
    "buffer": lambda a: memoryview(a).__setitem__((0, 0), 3),
    "iterator": lambda a: np.nditer(a, op_flags=[["readwrite"]]),
}


def _numbers() -> np.ndarray:
    return np.arange(6, dtype=np.int32).reshape(2, 3)


@pytest.mark.parametrize("way", _WRITES)
def test_every_way_of_writing_is_refused_with_the_advice(way: str) -> None:
    array = _numbers()
    with pytest.raises(ValueError, match=_ADVICE):
        _WRITES[way](ReadOnly.of(array, _ADVICE))
    np.testing.assert_array_equal(array, _numbers())


@pytest.mark.parametrize("way", _WRITES)
def test_every_way_of_writing_is_checked_and_does_as_to_an_ordinary_array(way: str) -> None:
    written, expected, asked = _numbers(), _numbers(), []

    def write(values: np.ndarray) -> None:
        asked.append(values)
        np.copyto(written, values)

    _WRITES[way](Checked.of(written, write))
    _WRITES[way](expected)
    assert len(asked) == 1
    np.testing.assert_array_equal(written, expected)


@pytest.mark.parametrize("way", _WRITES)
def test_a_check_that_raises_keeps_the_array(way: str) -> None:
    def refuse(values: np.ndarray) -> None:
        raise ValueError("no")

    array = _numbers()
    with pytest.raises(ValueError, match=r"^no$"):
        _WRITES[way](Checked.of(array, refuse))
    np.testing.assert_array_equal(array, _numbers())


@pytest.mark.parametrize("way", _REFUSED_BY_NUMPY)
def test_writing_past_the_class_is_refused(way: str) -> None:
    array = _numbers()
    for view in (Checked.of(array, lambda values: None), ReadOnly.of(array, _ADVICE)):
        with pytest.raises((ValueError, TypeError), match="read-only"):
            _REFUSED_BY_NUMPY[way](view)
    np.testing.assert_array_equal(array, _numbers())


def test_a_function_with_outputs_returns_them_and_what_it_makes_itself() -> None:
    array, other = _numbers(), np.zeros((2, 3), np.int32)
    divmod_: Any = np.divmod  # of which NumPy's annotations know no None
    view = Checked.of(array, lambda values: np.copyto(array, values))
    quotient, rest = divmod_(view, 2, out=(None, other))
    assert rest is other
    np.testing.assert_array_equal(quotient, _numbers() // 2)
    quotient, rest = divmod_(_numbers(), 2, out=(view, None))
    assert quotient is view
    np.testing.assert_array_equal(array, _numbers() // 2)
    np.testing.assert_array_equal(rest, _numbers() % 2)
    assert np.add(view, 1, out=other) is other
    assert np.add(view.copy(), 1, out=None).tolist() == (array + 1).tolist()


def test_two_guarded_outputs_of_one_function_are_refused() -> None:
    array = _numbers()
    view = Checked.of(array, lambda values: np.copyto(array, values))
    with pytest.raises(ValueError, match="write one field at a time"):
        np.divmod(view, 2, out=(view, view))


def test_elements_of_a_checked_array_are_read_as_of_any_other() -> None:
    array = _numbers()
    view = Checked.of(array, lambda values: np.copyto(array, values))
    assert list(view.flat) == list(array.flat)
    assert len(view.flat) == 6
    assert (view.flat[4], next(view.flat), view.flat.base is not None) == (4, 0, True)
    np.testing.assert_array_equal(np.asarray(view.flat), np.arange(6))
    assert type(view + 1) is type(np.asarray(view)) is np.ndarray
    copied = view.copy()
    copied[:] = 1
    copied.fill(2)
    copied.flat = 3
    empty = Checked.of(array[:0], lambda values: None)
    empty[:] = 1
    np.testing.assert_array_equal(array, _numbers())
    assert pickle.loads(pickle.dumps(view)).tolist() == view.tolist()


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
