"""The state of workers in words."""

from limberjack.workers import State


def test_only_what_occurs_is_shown() -> None:
    assert str(State(4, 3)) == "3 of 4 workers playing"
    assert str(State(4, 1, starting=2, lost=5)) == "1 of 4 workers playing, 2 starting, 5 lost"
