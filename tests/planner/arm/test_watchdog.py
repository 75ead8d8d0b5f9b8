"""The watchdog: what counts as headway, and when an arm is stuck."""

from limberjack.planner.arm.watchdog import Watchdog


def test_an_arm_is_stuck_when_no_distance_has_fallen_clearly_for_longer_than_the_patience() -> None:
    watchdog = Watchdog(patience=2, headway=0.03)
    assert not watchdog.watch({"object": 0.5})  # the first one is headway
    assert not watchdog.watch({"object": 0.48})  # too little
    assert watchdog.watch({"object": 0.471})
    assert watchdog.is_stuck
    assert not watchdog.watch({"object": 0.469})
    assert not watchdog.watch({"object": 0.6})  # only its least so far counts
    assert watchdog.watch({"object": 0.45})


def test_each_distance_is_headway_by_itself_and_a_new_one_too() -> None:
    watchdog = Watchdog(patience=1, headway=0.03)
    watchdog.watch({"object": 0.5})
    assert not watchdog.watch({"object": 0.5, "fingertip": 0.2})
    assert not watchdog.watch({"object": 0.5, "fingertip": 0.1})
    assert watchdog.watch({"object": 0.5, "fingertip": 0.1})
    watchdog.begin("fingertip")
    assert not watchdog.is_stuck
    assert not watchdog.watch({"object": 0.5})
    assert not watchdog.watch({"object": 0.5, "fingertip": 0.3})  # as if it were new
    assert watchdog.watch({"object": 0.49, "fingertip": 0.3})  # that of the object is not


def test_a_share_is_of_the_least_distance_so_far() -> None:
    watchdog = Watchdog(patience=1, share=0.9)
    watchdog.watch({"box": 0.1})
    assert watchdog.watch({"box": 0.091})
    assert not watchdog.watch({"box": 0.089})


def test_another_pursuit_begins_anew() -> None:
    watchdog = Watchdog(patience=1, headway=0.03)
    for pursued in ("one", "other", "one"):
        assert not watchdog.watch({"lack": 0.5}, pursued)
        assert watchdog.watch({"lack": 0.5}, pursued)


def test_without_distances_it_counts_how_long_something_lasts() -> None:
    watchdog = Watchdog(patience=2)
    for _ in range(2):
        assert [watchdog.watch() for _ in range(4)] == [False, False, True, True]
        watchdog.begin()
    assert [watchdog.watch(part=0.5) for _ in range(5)] == [False] * 4 + [True]
