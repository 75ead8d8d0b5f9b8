"""Reports on running work: workers in words, and episodes of a part."""

from limberjack.workers import State, counted_from


def test_only_what_occurs_is_shown() -> None:
    assert str(State(4, 3)) == "3 of 4 workers playing"
    assert str(State(4, 1, starting=2, lost=5)) == "1 of 4 workers playing, 2 starting, 5 lost"


def test_episodes_of_a_part_are_counted_after_those_before_it() -> None:
    seen: list[tuple[str, int, float]] = []
    counted_from(64, lambda *report: seen.append(report))("random", 3, 0.5)
    counted_from(64, None)("random", 3, 0.0)
    assert seen == [("random", 67, 0.5)]
