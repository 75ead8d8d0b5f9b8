"""The types of policies."""

import asyncio
import re
from typing import cast

import pytest

from limberjack import policies
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


class _Sixth:
    """The part of a policy that says how often it acts."""

    name = "every sixth"
    action_repeat = 6


def test_actions_are_repeated_as_asked_or_demanded_or_as_the_environment_does() -> None:
    sixth, free = cast(kinds.Actor, _Sixth()), policies.find("zero")
    assert [kinds.repeat_for(free, asked, 3) for asked in (None, 1, 2)] == [3, 1, 2]
    for asked, own in ((None, 1), (None, 6), (6, 3)):
        assert kinds.repeat_for(sixth, asked, own) == 6
    for asked, own, repeat in ((None, 3, 3), (1, 1, 1), (2, 6, 2)):
        with pytest.raises(ValueError, match=f"is {repeat}, but policy 'every sixth' acts every 6"):
            kinds.repeat_for(sixth, asked, own)


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
