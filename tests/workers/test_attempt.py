"""Units where they are played: errors become values."""

import dataclasses
import pickle
import re
import socket
from typing import Any

import pytest

from limberjack.policies import PolicyError
from limberjack.workers import prepare
from limberjack.workers.attempt import Answer, Failed, attempt

from .playing import TASK, seeds_of

_NODE = f"; on node {socket.gethostname()}"


def _raising(error: BaseException, *notes: str) -> Any:
    def function(setup: object, seeds: object) -> None:
        for note in notes:
            error.add_note(note)
        raise error

    return function


def test_a_result_is_an_answer() -> None:
    assert attempt(seeds_of, prepare(*TASK, "random"), (3, 4)) == Answer((3, 4))


@pytest.mark.parametrize(
    ("error", "notes", "message"),
    [
        (PolicyError("policy 'p', step 3: nan"), [], "policy 'p', step 3: nan"),
        (KeyError("a\nb"), ["policy 'p', step 3"], r"policy 'p', step 3: KeyError: 'a\nb'"),
        (OSError("two\nlines"), [], "OSError: two lines"),
        (AssertionError(), [], "AssertionError"),
        (SystemExit("enough"), [], "SystemExit: enough"),
    ],
)
def test_an_error_is_one_line_with_its_notes_and_the_node(
    error: BaseException, notes: list[str], message: str
) -> None:
    failed = attempt(_raising(error, *notes), prepare(*TASK, "random"), (0,))
    assert isinstance(failed, Failed)
    assert failed.message.startswith(message)
    assert failed.message.endswith(_NODE)
    place = failed.message.removeprefix(message).removesuffix(_NODE)
    if isinstance(error, PolicyError):  # whose message has it
        assert place == ""
    else:
        assert re.fullmatch(r" \(.*test_attempt\.py, line \d+, in function\)", place)
    assert pickle.loads(pickle.dumps(failed)) == failed


def test_a_refusal_names_the_node_once() -> None:
    setup = dataclasses.replace(prepare(*TASK, "random"), canary="0")
    failed = attempt(seeds_of, setup, (0,))
    assert isinstance(failed, Failed)
    assert failed.message.count(socket.gethostname()) == 1


@pytest.mark.parametrize("error", [MemoryError(), KeyboardInterrupt()])
def test_what_another_worker_may_survive_is_raised(error: BaseException) -> None:
    with pytest.raises(type(error)):
        attempt(_raising(error), prepare(*TASK, "random"), (0,))
