"""A program in a forked process behaves as in a new one; the tests of pages rely on it."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import programs, warm

_REPORT = """
import json, os, pickle, sys, warnings

class Kept:
    pass

print(json.dumps({
    "arguments": sys.argv,
    "variable": os.environ.get("OF_THIS_TEST"),
    "directory": os.getcwd(),
    "input": sys.stdin.read(),
    "main": type(pickle.loads(pickle.dumps(Kept()))).__module__,
    "names": sorted(name for name in globals() if not name.startswith("__")),
    "filters": [str(one) for one in warnings.filters],
    "first": sys.path[:2],
    "has the suite": "limberjack.suite" in sys.modules,
}))
"""


@pytest.mark.parametrize("run", [programs.run, warm.run])
def test_a_program_meets_what_it_meets_in_a_new_process(
    run: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OF_THIS_TEST", "set")
    monkeypatch.chdir(tmp_path)
    # Gymnasium adds a warning filter when it is imported.
    found = json.loads(run("import gymnasium" + _REPORT, "one", path=tmp_path / "first"))
    assert found["arguments"] == ["-c", "one"]
    assert (found["variable"], found["directory"]) == ("set", os.getcwd())
    assert (found["input"], found["main"]) == ("", "__main__")
    assert found["names"] == ["Kept", "gymnasium", "json", "os", "pickle", "sys", "warnings"]
    assert any("error" in one for one in found["filters"])
    assert found["first"] == ["", str(tmp_path / "first")]
    assert not found["has the suite"]


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("raise ValueError('no such thing')", "ValueError: no such thing"),
        ("import warnings; warnings.warn('beware')", "UserWarning: beware"),
        ("import sys; sys.stderr.write('a complaint')", "a complaint"),
        ("import sys; sys.exit(3)", "status '3'"),
        ("import os; os.kill(os.getpid(), 9)", "status '-9'"),
    ],
)
def test_a_program_that_fails_fails_the_test_and_not_the_next_program(
    program: str, message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        warm.run(program)
    assert warm.run("print('still here')") == "still here\n"
