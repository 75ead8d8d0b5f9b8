"""Bits of this machine beside stored ones: one planted bit is found with task, step and field."""

import dataclasses

import numpy as np
import pytest

from limberjack.doctor import exactness
from limberjack.doctor.exactness import Amount, Played, compare, departure, played
from limberjack.doctor.stored_bits import KEPT, Field, Kind, Run, StoredBits, field_of

_TASK = "cartpole:balance"


@pytest.fixture(scope="module")
def found() -> Played:
    """The task as it is here."""
    return played(*_TASK.split(":"))


@pytest.fixture
def stored(found: Played) -> StoredBits:
    """Its bits as if they were stored here."""
    return StoredBits([Run(Kind.here(), {_TASK: _fields(found)})])


def _fields(one: Played) -> dict[str, Field]:
    return {name: field_of(values) for name, values in one.single.items()}


def _planted(one: Played, how: str, field: str, *places: tuple[int, ...]) -> Played:
    """The same with the last bit of some numbers changed."""
    values = {name: array.copy() for name, array in getattr(one, how).items()}
    for place in places:
        values[field].view(np.uint64)[place] ^= np.uint64(1)
    return dataclasses.replace(one, **{how: values})


def test_batches_return_the_bits_of_single_environments(found: Played) -> None:
    assert list(found.single) == list(found.batch) == ["position", "velocity", "reward"]
    for name, values in found.single.items():
        assert values.shape[:2] == (KEPT[-1] + 1, 2)
        np.testing.assert_array_equal(values.view(np.uint64), found.batch[name].view(np.uint64))
    assert (found.single["position"][:, 0] != found.single["position"][:, 1]).any(-1).all()


def test_nothing_departs_from_the_same_bits(found: Played) -> None:
    assert departure(_TASK, _fields(found), found) is None


@pytest.mark.parametrize("how", ["single", "batch"])
@pytest.mark.parametrize("field", ["velocity", "reward"])
def test_one_bit_is_found_with_task_step_and_field(found: Played, how: str, field: str) -> None:
    place = (20, 1) if field == "reward" else (20, 1, 0)
    first = departure(_TASK, _fields(found), _planted(found, how, field, place))
    assert first is not None
    assert (first.task, first.how, first.step, first.field) == (_TASK, how, 20, field)
    size = np.spacing(abs(getattr(found, how)[field][place]))
    assert 0 < first.amounts[0].difference <= size
    assert first.amounts[1:] == (Amount(60, 0.0),)
    assert first.largest == first.amounts[0].difference


def test_the_first_of_several_steps_and_fields_is_named(found: Played) -> None:
    later = _planted(found, "single", "position", (31, 0, 1))
    both = _planted(later, "single", "reward", (7, 1), (60, 1))
    first = departure(_TASK, _fields(found), both)
    assert first is not None
    assert (first.step, first.field) == (7, "reward")
    assert [amount.step for amount in first.amounts] == [20, 60]
    assert first.amounts[0].difference == 0
    assert first.largest == first.amounts[1].difference > 0


def test_fields_are_compared_by_name(found: Played) -> None:
    turned = Played(dict(reversed(list(found.single.items()))), found.batch)
    assert departure(_TASK, _fields(found), turned) is None


@pytest.fixture
def planted(monkeypatch: pytest.MonkeyPatch, found: Played) -> Played:
    """This machine, as if a velocity of its batches had another last bit."""
    one = _planted(found, "batch", "velocity", (3, 0, 0))
    monkeypatch.setattr(exactness, "played", lambda domain, task: one)
    return one


def test_a_machine_with_the_stored_bits_is_bit_equal(stored: StoredBits) -> None:
    shown: list[tuple[str, int, int]] = []
    result = compare(stored, on_progress=lambda *now: shown.append(now))
    assert shown == [(_TASK, 0, 1)]
    assert result.is_equal
    assert (result.tasks, result.departures, result.unequal_batches) == (1, (), ())
    assert result.here == result.stored == Kind.here()


def test_a_batch_that_differs_from_single_environments_is_named(
    stored: StoredBits, planted: Played
) -> None:
    result = compare(stored)
    assert not result.is_equal
    for (first,) in (result.departures, result.unequal_batches):
        assert (first.how, first.step, first.field) == ("batch", 3, "velocity")


def test_an_equal_run_of_another_kind_counts_before_the_nearest(
    found: Played, stored: StoredBits
) -> None:
    other = _planted(found, "single", "velocity", (5, 0, 0))
    far = dataclasses.replace(Kind.here(), machine="far")
    near = StoredBits([Run(Kind.here(), {_TASK: _fields(other)})])
    result = compare(near.with_run(Run(far, stored.runs[0].tasks)))
    assert (result.is_equal, result.stored) == (True, far)
    result = compare(near)
    assert (result.is_equal, result.stored) == (False, Kind.here())
    assert result.departures[0].step == 5
    second = Run(far, near.runs[0].tasks)
    assert compare(StoredBits([second, *near.runs])).stored == Kind.here()


def test_the_packages_bits_are_those_of_this_machine_where_its_kind_is_stored() -> None:
    # Two tasks whose bits depend on the processor; all take half a minute: `doctor --exact`.
    result = compare(tasks=["acrobot:swingup", "stacker:stack_2"])
    assert result.unequal_batches == ()
    if Kind.here() not in [run.kind for run in StoredBits.read().runs]:
        pytest.skip(f"no bits are stored for {Kind.here()}, which tools/record_bits.py can add")
    assert result.departures == ()


@pytest.mark.parametrize("name", ["walker:wlak", "walker", "plain:push"])
def test_a_task_that_is_not_stored_is_named(name: str) -> None:
    with pytest.raises(ValueError, match=f"no bits of '{name}' are stored; expected names"):
        compare(tasks=["cartpole:balance", name])
