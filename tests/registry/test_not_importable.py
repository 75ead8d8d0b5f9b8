"""Pickling a domain that only this process has."""

import copy
import pickle

import pytest

from limberjack.registry import NotImportable


def test_it_is_copied_and_refuses_to_be_pickled_with_advice() -> None:
    nowhere = NotImportable("swing")
    assert copy.deepcopy(nowhere) is nowhere
    with pytest.raises(pickle.PicklingError, match=r"'swing' .* such as my_package/swing\.py"):
        pickle.dumps(nowhere)
