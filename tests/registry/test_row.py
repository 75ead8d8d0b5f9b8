"""Rows: facts about a task, which the package and other processes pass around."""

import pickle

import pytest

from limberjack import registry
from limberjack.registry import Row

_ROW = Row("swing", "up", ("easy",), None, 1)


def test_a_row_has_its_facts_in_order_and_by_name() -> None:
    domain, task, tags, steps, dof = _ROW
    assert (domain, task, tags, steps, dof) == ("swing", "up", ("easy",), None, 1)
    assert (_ROW.domain, _ROW.task, _ROW.tags, _ROW.steps, _ROW.dof) == _ROW


def test_rows_are_values_that_cannot_be_changed() -> None:
    assert len({_ROW, Row("swing", "up", ("easy",), None, 1), _ROW._replace(dof=2)}) == 2
    with pytest.raises(AttributeError):
        _ROW.steps = 5  # pyright: ignore[reportAttributeAccessIssue]


def test_a_row_is_pickled_as_itself() -> None:
    copy = pickle.loads(pickle.dumps(_ROW))
    assert type(copy) is Row
    assert copy == _ROW


def test_the_suites_rows_have_facts_of_the_right_kinds() -> None:
    for row in registry.TASKS:
        assert row.domain.isidentifier()
        assert row.task.isidentifier()
        assert type(row.tags) is tuple
        assert row.steps is None or row.steps > 0
        assert row.dof > 0
