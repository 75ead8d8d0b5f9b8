"""Errors of a user's code on one line."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from limberjack.rl.guards import at_least_one
from limberjack.utils.described import described, is_of_user, place_of

_MODULE = """
import numpy as np

def own():
    return {}["missing"]

def of_a_library():
    return np.linalg.inv(np.zeros((2, 2)))

def long():
    raise ValueError("x" * 5000)

def empty():
    raise KeyError
"""


@pytest.fixture
def error_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Exception]:
    """The error that a function of a module of the user's raises."""
    (tmp_path / "of_a_user.py").write_text(_MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    module = importlib.reload(importlib.import_module("of_a_user"))

    def caught(name: str) -> Exception:
        with pytest.raises(Exception) as raised:  # noqa: PT011 (of any kind)
            getattr(module, name)()
        return raised.value

    return caught


def test_the_line_has_notes_kind_text_and_place(error_of: Callable[[str], Exception]) -> None:
    error = error_of("own")
    error.add_note("policy 'a:b',\n step 3")
    line = "policy 'a:b', step 3: KeyError: 'missing' (of_a_user.py, line 5, in own)"
    assert described(error) == line
    assert described(error_of("empty")) == "KeyError (of_a_user.py, line 14, in empty)"


def test_the_place_is_in_the_users_code_though_a_library_raises(
    error_of: Callable[[str], Exception],
) -> None:
    error = error_of("of_a_library")
    assert is_of_user(error)
    assert place_of(error) == "of_a_user.py, line 8, in of_a_library"


def test_a_long_text_is_cut_off(error_of: Callable[[str], Exception]) -> None:
    assert len(described(error_of("long"))) < 1200


def _without_this_file(function: Callable[[], object]) -> Exception:
    """The error of a function that this package or a library raises, as if it had been called."""
    with pytest.raises(Exception) as raised:  # noqa: PT011 (of any kind)
        function()
    error = raised.value
    trace = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename == __file__:
        trace = trace.tb_next
    return error.with_traceback(trace)


def test_an_error_of_this_package_or_of_python_has_no_place() -> None:
    for function in (lambda: at_least_one("rows", 0), lambda: json.loads("{")):
        error = _without_this_file(function)
        assert not is_of_user(error)
        assert place_of(error) is None
        assert described(error) == f"{type(error).__name__}: {error}"


def test_without_code_of_the_users_the_place_is_in_a_library() -> None:
    error = _without_this_file(lambda: np.linalg.inv(np.zeros((2, 2))))
    assert not is_of_user(error)
    assert "linalg" in str(place_of(error))
