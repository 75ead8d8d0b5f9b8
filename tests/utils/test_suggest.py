"""Tests of limberjack.utils.suggest."""

import pytest

from limberjack.utils.suggest import check_names, did_you_mean

DOMAINS = ["humanoid", "manipulator", "stacker"]


def test_a_misspelled_name_brings_the_nearest_choice() -> None:
    assert did_you_mean("humaniod", DOMAINS) == " Did you mean 'humanoid'?"
    assert did_you_mean("stack", DOMAINS) == " Did you mean 'stacker'?"


def test_case_does_not_count_and_the_choice_keeps_its_own() -> None:
    assert did_you_mean("HUMANOID", DOMAINS) == " Did you mean 'humanoid'?"
    assert did_you_mean("humanoid_cmu", ["humanoid_CMU"]) == " Did you mean 'humanoid_CMU'?"


def test_a_name_unlike_any_choice_brings_nothing() -> None:
    assert did_you_mean("xyz", DOMAINS) == ""
    assert did_you_mean("humanoid", []) == ""


def test_values_that_are_not_strings_bring_nothing() -> None:
    assert did_you_mean(3, DOMAINS) == ""
    assert did_you_mean(None, DOMAINS) == ""


def test_choices_may_be_any_iterable() -> None:
    assert did_you_mean("walk", iter(["walks", "run"])) == " Did you mean 'walks'?"
    assert did_you_mean("walk", {"walks": 1}) == " Did you mean 'walks'?"


def test_a_name_that_is_not_known_is_refused_with_all_that_are() -> None:
    known = iter(["camera", "height"])
    check_names("pixels has no option", ["height"], ["camera", "height"])
    expected = (
        r"^pixels has no option 'heigth'\. Did you mean 'height'\? It takes: camera, height\.$"
    )
    with pytest.raises(TypeError, match=expected):
        check_names("pixels has no option", ["camera", "heigth"], known)
