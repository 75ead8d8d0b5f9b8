"""Checks of the arguments of `Env` and `VectorEnv`."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from limberjack import suite
from limberjack.gym import arguments

_LARGEST = 2**32 - 1


def test_one_seed_gives_each_row_the_next_one() -> None:
    assert arguments.row_seeds(np.int64(5), 3) == [5, 6, 7]
    assert arguments.row_seeds(None, 2) == [None, None]


def test_a_sequence_gives_each_row_its_own_seed_or_none() -> None:
    assert arguments.row_seeds([4, None, _LARGEST], 3) == [4, None, _LARGEST]
    assert arguments.row_seeds(np.array([2, 1]), 2) == [2, 1]


def test_the_last_rows_seed_must_be_valid_too() -> None:
    assert arguments.row_seeds(_LARGEST - 2, 3)[-1] == _LARGEST
    with pytest.raises(ValueError, match=f"last of 4 rows would have seed {_LARGEST + 1}"):
        arguments.row_seeds(_LARGEST - 2, 4)


@pytest.mark.parametrize(
    ("seed", "error", "message"),
    [
        ([1, 2], ValueError, "there are 2 seeds; expected 3"),
        ([1, 2, -1], ValueError, "seed is -1"),
        ([1, 2, 0.5], TypeError, "seed is 0.5"),
        (1.5, TypeError, "seed is 1.5"),
    ],
)
def test_seeds_that_rows_cannot_have_are_refused(seed: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        arguments.row_seeds(seed, 3)


def test_a_mask_is_copied() -> None:
    given = np.array([True, False, True])
    mask = arguments.reset_mask({"reset_mask": given}, 3)
    given[:] = False
    assert mask is not None
    assert mask.tolist() == [True, False, True]


def test_without_a_mask_there_is_none() -> None:
    assert arguments.reset_mask(None, 3) is None
    assert arguments.reset_mask({}, 3) is None
    assert arguments.reset_mask({"state": 1}, 3, "state") is None
    with pytest.raises(TypeError, match="has 'state', which reset does not take"):
        arguments.reset_mask({"state": 1}, 3)


def test_options_are_known_by_name() -> None:
    assert arguments.check_options(None, "state") == {}
    assert arguments.check_options({"state": 1}, "state") == {"state": 1}
    with pytest.raises(TypeError, match="options is 3; expected a mapping, which may have 'state'"):
        arguments.check_options(3, "state")
    with pytest.raises(TypeError, match=r"options has 'stat', .*Did you mean 'state'"):
        arguments.check_options({"stat": 1}, "state")


def test_a_batch_is_known_by_its_interface() -> None:
    assert arguments.is_batch(suite.load_batch("humanoid", "walk", 1))
    assert not arguments.is_batch(suite.load("humanoid", "walk"))


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        ([True, False], TypeError, "expected an array of booleans"),
        (np.array([1, 0]), TypeError, "expected an array of booleans"),
        (np.array([True]), ValueError, r"shape \(1,\); expected \(2,\)"),
        (np.array([False, False]), ValueError, "selects no row"),
    ],
)
def test_an_invalid_mask_is_refused(mask: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        arguments.reset_mask({"reset_mask": mask}, 2)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_mode_is_given_as_itself_or_by_its_value(mode: AutoresetMode) -> None:
    assert arguments.autoreset_mode(mode) is arguments.autoreset_mode(mode.value) is mode


def test_an_unknown_mode_is_refused_with_a_suggestion_and_the_list() -> None:
    with pytest.raises(ValueError, match="Did you mean 'SameStep'") as caught:
        arguments.autoreset_mode("same_step")
    assert all(mode.value in str(caught.value) for mode in AutoresetMode)


def test_render_modes_are_none_and_pictures() -> None:
    assert arguments.render_mode(None) is None
    assert arguments.render_mode("rgb_array") == "rgb_array"
    with pytest.raises(ValueError, match="'human'; expected None or one of: rgb_array"):
        arguments.render_mode("human")


def test_keywords_are_known_if_any_of_the_callables_takes_them_by_name() -> None:
    def first(positional: int, *, flat: bool = False) -> None: ...

    def second(*, dtype: str = "float64") -> None: ...

    arguments.refuse_unknown({"flat": 1, "dtype": 2}, first, second)
    with pytest.raises(TypeError, match=r"keyword argument 'dtpye'\. Did you mean 'dtype'"):
        arguments.refuse_unknown({"dtpye": 1}, first, second)
    with pytest.raises(TypeError, match="keyword argument 'positional'"):
        arguments.refuse_unknown({"positional": 1}, first, second)


def test_a_function_that_suggests_names_works_as_before() -> None:
    @arguments.suggests_names
    def add(first: int, *, second: int = 0) -> int:
        """A sum."""
        return first + second

    assert add(1) == 1
    assert add(first=1, second=2) == 3
    assert add.__doc__ == "A sum."
    wrong: Any = add
    with pytest.raises(
        TypeError,
        match=r"keyword argument 'secnod'\. Did you mean 'second'\? It takes: first, second",
    ):
        wrong(1, secnod=2)
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        wrong()


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((None, None, None, None, None), {}),
        (
            ({"camera": "side"}, 64, 48, None, None),
            {"camera_id": "side", "width": 64, "height": 48},
        ),
        ((None, None, None, 0, None), {"camera_id": 0}),
        (({"quality": "fast"}, None, None, None, "side"), {"camera_id": "side", "quality": "fast"}),
    ],
)
def test_the_arguments_of_a_picture_are_joined(given: Any, expected: dict[str, object]) -> None:
    assert arguments.picture_arguments(*given) == expected


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((None, None, None, 0, "side"), "camera_id is 0 and camera_name is 'side'; expected one"),
        (({"width": 3}, 64, None, None, None), "width is given twice"),
        (({"camera": 0}, None, None, None, "side"), "camera_id is given twice"),
        (({"camra": 0}, None, None, None, None), "'camra'. Did you mean 'camera_id'"),
    ],
)
def test_arguments_of_a_picture_that_contradict_or_are_unknown_are_refused(
    given: Any, message: str
) -> None:
    with pytest.raises(TypeError, match=message):
        arguments.picture_arguments(*given)
