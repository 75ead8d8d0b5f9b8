"""Tests of limberjack.worlds.appearance.backdrop."""

import colorsys

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from limberjack.worlds.appearance.backdrop import Noise, Shown, is_green, on_green_screen
from limberjack.worlds.appearance.media import Clip


class _Numbers(Clip):
    """A clip whose frames show their numbers."""

    def __init__(self, count: int) -> None:
        super().__init__([], is_video=False)
        self.count = count

    @property
    def length(self) -> int:
        return self.count

    def frame(self, number: int) -> np.ndarray:
        assert 0 <= number < self.count
        return np.full((4, 4, 3), number, np.uint8)


def _seen(shown: Shown, count: int) -> list[int]:
    return [int(shown.at(changes)[0, 0, 0]) for changes in range(count)]


def test_noise_is_colourful_smooth_and_moves() -> None:
    noise = Noise(np.random.RandomState(0))
    first, next_one, late = (noise.at(changes).astype(int) for changes in (0, 1, 40))
    assert first.std() > 20
    assert np.abs(np.diff(first, axis=0)).max() < 60
    assert 0 < np.abs(next_one - first).mean() < 20
    assert np.abs(late - first).mean() > 20
    assert_array_equal(Noise(np.random.RandomState(0)).at(40), late)
    assert np.abs(Noise(np.random.RandomState(1)).at(0) - first).mean() > 20


def test_a_clip_goes_forwards_and_backwards_between_its_ends() -> None:
    clip = _Numbers(4)
    assert _seen(Shown(clip, 1, 1), 10) == [1, 2, 3, 3, 2, 1, 0, 1, 2, 3]
    assert _seen(Shown(clip, 2, -1), 7) == [2, 1, 0, 1, 2, 3, 3]
    assert _seen(Shown(_Numbers(1), 0, -1), 3) == [0, 0, 0]


def test_a_fixed_background_is_any_frame_of_any_clip() -> None:
    clips = [_Numbers(3), _Numbers(5)]
    shown = [Shown.random(np.random.RandomState(seed), clips, False) for seed in range(100)]
    assert {(len(_seen(one, 1)), one.clip.length, one.first) for one in shown} == {
        *((1, 3, first) for first in range(3)),
        *((1, 5, first) for first in range(5)),
    }
    assert _seen(shown[0], 4) == [shown[0].first] * 4


def test_clips_in_turn_begin_at_the_first_frame_and_repeat() -> None:
    clips = [_Numbers(3), _Numbers(2)]
    assert _seen(Shown.next(0, clips, True), 5) == [0, 1, 2, 0, 1]
    assert Shown.next(3, clips, True).clip is clips[1]
    assert _seen(Shown.next(0, clips, False), 3) == [0, 0, 0]


def test_green_pixels_are_those_of_the_published_range() -> None:
    random = np.random.RandomState(0)
    picture = random.randint(0, 256, (60, 60, 3)).astype(np.uint8)
    picture[0] = [51, 204, 51]
    picture[1] = 128
    expected = np.zeros((60, 60), bool)
    for place in np.ndindex(60, 60):
        hue, saturation, value = colorsys.rgb_to_hsv(*(picture[place] / 255.0))
        expected[place] = (
            100 <= hue * 360 <= 185 and 80 <= saturation * 255 <= 255 and 70 <= value * 255 <= 255
        )
    # The limits are reached by no pixel but through rounding.
    assert_array_equal(is_green(picture), expected)
    assert expected[0].all()
    assert not expected[1].any()
    assert 0.05 < expected[2:].mean() < 0.5


@pytest.mark.parametrize("size", [(4, 4), (6, 8)])
def test_only_green_pixels_show_the_frame(size: tuple[int, int]) -> None:
    picture = np.full((*size, 3), 10, np.uint8)
    picture[1:3, 1:3] = [51, 204, 51]
    shown = on_green_screen(picture, np.full((16, 16, 3), 99, np.uint8))
    assert (shown[1:3, 1:3] == 99).all()
    assert (shown == 99).all(axis=-1).sum() == 4
    assert (shown[0] == 10).all()
