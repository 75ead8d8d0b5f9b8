"""Tests of limberjack.worlds.appearance.options."""

import json
from typing import Any

import numpy as np
import pytest

from limberjack.worlds.appearance.options import INTENSITIES, PRESETS, Appearance


def test_names_stand_for_the_published_scales() -> None:
    scales = [Appearance.of({"colors": name}).colors for name in ("easy", "medium", "hard")]
    assert scales == [0.1, 0.2, 0.3]
    assert Appearance.of({"camera": "medium"}).camera == 0.2
    assert [Appearance.of({"palette": name}).palette for name in ("easy", "hard")] == [0.1, 0.2]
    assert [Appearance.of({"rotate": name}).rotate for name in ("easy", "hard")] == [90, 180]
    assert [Appearance.of({"shift": name}).shift for name in ("easy", "hard")] == [1 / 1.5, 1]
    assert [Appearance.of({"clips": name}).clips for name in ("easy", "medium", "hard")] == [
        4,
        8,
        None,
    ]


@pytest.mark.parametrize(
    ("background", "dynamic", "moving"),
    [
        ("noise", None, ("background",)),
        ("video:film.mp4", None, ("background",)),
        ("images:photos", None, ()),
        (None, None, ()),
        ("noise", False, ()),
        ("images:photos", True, ("background", "colors", "camera")),
        (None, ["camera", "colors"], ("colors", "camera")),
    ],
)
def test_noise_and_videos_move_unless_it_is_said_otherwise(
    background: str | None, dynamic: Any, moving: tuple[str, ...]
) -> None:
    options = Appearance.of({"background": background, "dynamic": dynamic})
    assert options.moving == moving
    assert Appearance(background, dynamic=dynamic) == options
    if dynamic is None:
        assert Appearance.of({"background": background}) == options
    assert set(Appearance.of(options.as_json()).moving) == {
        part for part in moving if getattr(options, part) is not None
    }


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_without_a_video_needs_nothing_else(name: str) -> None:
    needs_video = "video" in name or name == "distracting_cs"
    given: dict[str, object] = {"preset": name}
    if name == "distracting_cs":
        given["intensity"] = 0.1
    if needs_video:
        with pytest.raises(ValueError, match=r"needs videos.*background"):
            Appearance.of(given)
        given["background"] = "noise"
    assert Appearance.of(given) != Appearance()


def test_the_presets_are_the_modes_of_the_benchmarks() -> None:
    def of(name: str) -> dict[str, object]:
        return Appearance.of({"preset": name, "background": "noise"}).as_json()

    background = {"background": "noise", "order": "next", "dynamic": ["background"], "interval": 1}
    behind = {**background, "place": "scene"}
    assert of("video_easy") == {**background, "place": "picture", "clips": 10, "floor": 1.0}
    assert of("video_hard") == {**background, "place": "picture", "clips": 100, "floor": 0.0}
    assert of("video_easy_scene") == {**behind, "clips": 10, "floor": 1.0}
    assert of("video_hard_scene") == {**behind, "clips": 100, "floor": 0.0}
    assert of("color_video_easy") == {**behind, "clips": 10, "floor": 1.0, "palette": 0.1}
    assert of("color_video_hard") == {**behind, "clips": 100, "floor": 1.0, "palette": 0.2}
    assert Appearance.of("color_hard").as_json() == {"palette": 0.2}
    assert Appearance.of("rotate_shift_easy").as_json() == {"rotate": 90.0, "shift": 1 / 1.5}


@pytest.mark.parametrize("intensity", INTENSITIES)
def test_distracting_cs_changes_everything_at_every_second_step(intensity: float) -> None:
    given = {"preset": "distracting_cs", "intensity": intensity, "background": "images:davis"}
    options = Appearance.of(given)
    assert (options.colors, options.camera) == (intensity, intensity)
    assert options.clips == INTENSITIES[intensity]
    assert options.moving == ("background", "colors", "camera")
    assert options.interval == 2
    assert options.floor is None


def test_a_text_has_a_preset_its_intensity_and_its_background() -> None:
    given = {"preset": "distracting_cs", "intensity": 0.1, "background": "images:a=b"}
    assert Appearance.of("distracting_cs:0.1=images:a=b") == Appearance.of(given)
    expected = Appearance.of({"preset": "video_hard", "background": "noise"})
    assert Appearance.of("video_hard=noise") == expected
    with pytest.raises(ValueError, match=r"as in 'distracting_cs:0\.1=video:DIR'"):
        Appearance.of("distracting_cs:0.1")


def test_options_given_beside_a_preset_replace_its_own() -> None:
    given = {"preset": "distracting_cs", "intensity": "0.1", "background": "noise", "camera": 0.4}
    assert Appearance.of(given).camera == 0.4


@pytest.mark.parametrize(
    "given",
    [
        {"background": "noise", "colors": "hard", "dynamic": ["colors"], "interval": 3},
        {"background": "noise", "clips": np.int64(2), "interval": np.int64(2)},
        {"preset": "distracting_cs", "intensity": 0.2, "background": "video:films"},
        {"preset": "video_hard", "background": "noise"},
        "rotate_shift_hard",
    ],
)
def test_options_are_the_same_after_json(given: Any) -> None:
    options = Appearance.of(given)
    again = Appearance.of(json.loads(json.dumps(options.as_json())))
    assert again == options
    assert Appearance.of(json.dumps(options.as_json())) == options


def test_equal_pictures_have_equal_options() -> None:
    assert Appearance.of({"colors": 0.3, "clips": 3, "interval": 5}).as_json() == {"colors": 0.3}
    assert Appearance.of({"colors": 0.1, "dynamic": ["camera"]}).as_json() == {"colors": 0.1}


def test_a_hash_of_files_is_a_text() -> None:
    given = {"background": "images:photos", "files": "0f"}
    assert Appearance.of(given).as_json()["files"] == "0f"
    assert "files" not in Appearance.of({"colors": 0.1, "files": "0f"}).as_json()
    with pytest.raises(TypeError, match="files is 3; expected a SHA-256 as text"):
        Appearance.of({"files": 3})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (3, "appearance is 3; expected a preset such as 'color_hard', or a mapping"),
        ("color_hrad", "no preset 'color_hrad'. Did you mean 'color_hard'?"),
        ("", "no preset ''. Choose one of: color_easy, color_hard"),
        ("=noise", "no preset ''"),
        ("color_hard:0.1", "preset 'color_hard' has no intensity; got '0.1'"),
        ("distracting_cs:0.7", "no intensity '0.7'; expected one of 0.025, 0.05, 0.1"),
        ("distracting_cs", "distracting_cs has no intensity None; expected one of"),
        ({"intensity": 0.1}, "intensity 0.1 without a preset"),
        ('{"colors": ', "which is no JSON"),
        ({"color": "easy"}, "no option 'color'. Did you mean 'colors'?"),
        ({"colors": "esay"}, "colors is 'esay'; expected 'easy', 'medium', 'hard', or a number"),
        ({"colors": 1.5}, "colors is 1.5; expected .* a number from 0 to 1"),
        ({"camera": True}, "camera is True"),
        ({"camera": -0.1}, "camera is -0.1"),
        ({"camera": float("nan")}, "camera is nan"),
        ({"rotate": 200}, "rotate is 200; expected .* a number from 0 to 180"),
        ({"shift": -1}, "shift is -1; expected .* a number of at least 0"),
        ({"shift": float("inf")}, "shift is inf; expected .* a number of at least 0"),
        ({"floor": 2}, "floor is 2; expected a number from 0 to 1"),
        ({"background": "nois"}, "background is 'nois'; expected .* Did you mean 'noise'?"),
        ({"background": "images:"}, "background is 'images:'"),
        ({"background": 3}, "background is 3"),
        ({"clips": 0}, "clips is 0; expected 'easy', 'medium', 'hard', or a number of at least 1"),
        ({"clips": True}, "clips is True"),
        ({"place": "sky"}, "place is 'sky'; expected 'scene' or 'picture'"),
        ({"order": "nxt"}, "order is 'nxt'; expected 'random' or 'next'. Did you mean 'next'?"),
        ({"dynamic": "camera"}, "dynamic is 'camera'; expected True, False, or a list"),
        ({"dynamic": ["cam"]}, "dynamic has 'cam'; expected some of: background, colors, camera"),
        ({"interval": 0}, "interval is 0; expected at least 1"),
        ({"interval": 1.5}, "interval is 1.5; expected control steps"),
    ],
)
def test_what_is_no_appearance_is_refused_in_one_line(given: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message.replace("?", r"\?")) as raised:
        Appearance.of(given)
    assert "\n" not in str(raised.value)
