"""The types of policies."""

import asyncio
import re

import pytest

from limberjack.policies import kinds


def test_an_error_of_a_policy_is_a_value_error() -> None:
    assert issubclass(kinds.PolicyError, ValueError)


def test_an_error_of_a_users_code_is_raised_as_it_is_with_a_note() -> None:
    error = KeyError("x")
    with pytest.raises(KeyError) as caught, kinds.Locating("policy 'a:b', step 3"):
        raise error
    assert caught.value is error
    assert error.__notes__ == ["policy 'a:b', step 3"]
    with pytest.raises(KeyboardInterrupt) as interrupt, kinds.Locating("policy 'a:b', step 3"):
        raise KeyboardInterrupt
    assert not hasattr(interrupt.value, "__notes__")


class _Odd(BaseException):
    pass


@pytest.mark.parametrize(
    "error",
    [
        SystemExit(0),
        EOFError("No data left in file"),
        StopIteration(),
        GeneratorExit(),
        asyncio.CancelledError(),
        _Odd("x"),
    ],
)
def test_what_would_end_the_program_silently_is_an_error_of_the_policy(
    error: BaseException,
) -> None:
    with pytest.raises(kinds.PolicyError) as caught, kinds.Locating("policy 'a:b', step 3"):
        raise error
    line = re.escape(f"policy 'a:b', step 3: raised {error!r}")
    assert re.fullmatch(line + r" \(.*test_kinds\.py, line \d+, in test_\w+\)", str(caught.value))
    assert caught.value.__cause__ is error
