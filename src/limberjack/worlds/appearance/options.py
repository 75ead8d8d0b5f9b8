"""`Appearance`: how the pictures of an environment differ from the suite's.

    Appearance.of({"background": "noise", "colors": "hard", "camera": "easy"})
    Appearance.of({"preset": "video_easy", "background": "video:films"})
    Appearance.of("color_hard")               # a preset
    Appearance.of("video_easy=video:films")   # a preset with its background
    Appearance.of("distracting_cs:0.1=noise") # a preset with its intensity

`colors`, `camera` and backgrounds in the scene have the distributions, not the draws, of the
Distracting Control Suite (DCS; `distracting_control` in
https://github.com/google-research/google-research, commit 0c1bbe5). `palette`, and a video in the
finished picture, are those of DMC-GB (`src/env` in
https://github.com/nicklashansen/dmcontrol-generalization-benchmark, commit ff9c0aa); `rotate` and
`shift` are those of DMC-GB2 (`envs/dmcgb` in https://github.com/aalmuzairee/dmcgb2, commit
5fd8fd7).
"""

import dataclasses
import json
import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Self, cast

from limberjack.utils.suggest import check_names, did_you_mean

__all__ = ["INTENSITIES", "PRESETS", "Appearance", "AppearanceOptions", "level"]

AppearanceOptions = Mapping[str, object]  # the attributes of `Appearance`, checked by its `of`

# DIFFICULTY_SCALE and DIFFICULTY_NUM_VIDEOS of DCS: suite_utils.py.
_SCALES = {"easy": 0.1, "medium": 0.2, "hard": 0.3}
_CLIPS = {"easy": 4, "medium": 8, "hard": None}
# DMC-GB2: dmcgb_geometric.py.
_ROTATIONS = {"easy": 90.0, "hard": 180.0}  # degrees
_SHIFTS = {"easy": 1 / 1.5, "hard": 1.0}  # of the rectangle of directions
# DMC-GB: the standard deviation of the 100 colours in data/color_easy.pt and color_hard.pt.
_PALETTES = {"easy": 0.1, "hard": 0.2}
_PARTS = ("background", "colors", "camera")
_SOURCES = ("noise", "images", "video")
_PLACES = ("scene", "picture")
_ORDERS = ("random", "next")

# DMC-GB: the intensities of distracting_cs, with the number of videos, None for all.
INTENSITIES: dict[float, int | None] = {
    0.025: 2,
    0.05: 2,
    0.1: 4,
    0.15: 6,
    0.2: 8,
    0.3: None,
    0.4: None,
    0.5: None,
}

_VIDEO_EASY = {"clips": 10, "order": "next", "dynamic": ["background"]}
_VIDEO_HARD = {"clips": 100, "order": "next", "dynamic": ["background"], "floor": 0.0}
# The floor keeps its colour in these.
_VIDEO_BEHIND = {**_VIDEO_EASY, "floor": 1.0}
# The modes by name. A mode with a video needs the user's: its `background` is given beside it.
PRESETS: dict[str, AppearanceOptions] = {
    "color_easy": {"palette": "easy"},
    "color_hard": {"palette": "hard"},
    "video_easy": {**_VIDEO_BEHIND, "place": "picture"},
    "video_hard": {**_VIDEO_HARD, "place": "picture"},
    "video_easy_scene": _VIDEO_BEHIND,
    "video_hard_scene": _VIDEO_HARD,
    "color_video_easy": {**_VIDEO_BEHIND, "palette": "easy"},
    "color_video_hard": {**_VIDEO_BEHIND, "clips": 100, "palette": "hard"},
    "rotate_easy": {"rotate": "easy"},
    "rotate_hard": {"rotate": "hard"},
    "shift_easy": {"shift": "easy"},
    "shift_hard": {"shift": "hard"},
    "rotate_shift_easy": {"rotate": "easy", "shift": "easy"},
    "rotate_shift_hard": {"rotate": "hard", "shift": "hard"},
    "distracting_cs": {"dynamic": list(_PARTS), "interval": 2},
}
_WITH_VIDEO = tuple(name for name in PRESETS if "video" in name or name == "distracting_cs")


@dataclasses.dataclass(frozen=True)
class Appearance:
    """Options of the appearance, all of which leave the simulation as it is.

    Attributes:
      background: 'noise', procedural; 'images:DIR', a folder of pictures, or of folders of pictures
        such as those of DAVIS 2017, each a video; 'video:PATH', a file, or a folder of files; None
        for the suite's sky.
      place: 'scene', on the sky of the model; or 'picture', in place of the green pixels of a
        finished picture whose sky, and whose floor if that is 0, were painted green.
      clips: number of videos to choose from, the first ones by name; 'easy' is 4, 'medium' 8, and
        'hard' or None all.
      order: 'random' chooses a video for each episode; 'next' plays them in turn, from their
        beginning and over again.
      floor: opacity of the material 'grid', 0 to 1; None for that of DCS. In a picture, 0 paints
        the floor green too.
      colors: s: each material's colour is uniform within the original's +- s; or 'easy', 'medium',
        'hard' for 0.1, 0.2, 0.3. None for the suite's.
      palette: 'easy' or 'hard': colours of floor, body and sky, normal around the suite's with a
        standard deviation of 0.1 or 0.2; or a number for another one.
      camera: s: angles within +- (pi/2) s, and distances from 1 - 0.5 s to 1 + 1.5 s times the
        model's; the same names as of `colors`.
      rotate: rolls the camera by an angle within +- this many degrees; 'easy' is 90, 'hard' 180.
      shift: turns the camera away so that the body is on the border of a rectangle; 1 or 'hard' for
        that of DMC-GB2, 'easy' for 1/1.5 of it.
      dynamic: parts that change within an episode: some of 'background', 'colors' and 'camera'.
        True for all, False for none; None for a background of noise or video only.
      interval: control steps from one change to the next.
      files: SHA-256 of the background's files, which must be these; None for any.
    """

    background: str | None = None
    place: str = "scene"
    clips: int | str | None = None
    order: str = "random"
    floor: float | None = None
    colors: float | str | None = None
    palette: float | str | None = None
    camera: float | str | None = None
    rotate: float | str | None = None
    shift: float | str | None = None
    dynamic: bool | Sequence[str] | None = None
    interval: int = 1
    files: str | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__  # of a frozen dataclass
        _check_background(self.background)
        _one_of("place", self.place, _PLACES)
        _one_of("order", self.order, _ORDERS)
        put(self, "clips", _clips(self.clips))
        put(self, "floor", _bounded("floor", self.floor, {}, 1.0))
        put(self, "colors", _bounded("colors", self.colors, _SCALES, 1.0))
        put(self, "palette", _bounded("palette", self.palette, _PALETTES, 1.0))
        put(self, "camera", _bounded("camera", self.camera, _SCALES, 1.0))
        put(self, "rotate", _bounded("rotate", self.rotate, _ROTATIONS, 180.0))
        put(self, "shift", _bounded("shift", self.shift, _SHIFTS, math.inf))
        if self.files is not None and not isinstance(self.files, str):
            raise TypeError(f"appearance's files is {self.files!r}; expected a SHA-256 as text")
        put(self, "dynamic", _dynamic(self.dynamic, self.background))
        if isinstance(self.interval, bool) or not isinstance(self.interval, numbers.Integral):
            raise TypeError(f"appearance's interval is {self.interval!r}; expected control steps")
        if self.interval < 1:
            raise ValueError(f"appearance's interval is {self.interval}; expected at least 1")
        put(self, "interval", int(self.interval))  # one of NumPy's is no value of JSON

    @classmethod
    def of(cls, given: "AppearanceOptions | str | Appearance") -> Self:
        """Options from a mapping, or from a text: PRESET, PRESET=BACKGROUND, or JSON.

        In a mapping, 'preset' names one of `PRESETS`, whose options the others replace, and
        'intensity' is that of 'distracting_cs'.

        Raises:
          TypeError: it is neither, or has an unknown option.
          ValueError: an option has an invalid value, or there is no such preset or intensity.
        """
        if isinstance(given, cls):
            return given
        found = _parsed(given) if isinstance(given, str) else given
        if not isinstance(found, Mapping):
            raise TypeError(
                f"appearance is {given!r}; expected a preset such as 'color_hard', or a mapping "
                "such as {'background': 'noise', 'colors': 'hard'}"
            )
        options = _with_preset(found)
        known = [field.name for field in dataclasses.fields(cls)]
        check_names("appearance has no option", options, ["preset", "intensity", *known])
        # The fields check their own values; what moves by default depends on the background.
        return dataclasses.replace(cls(), **cast(dict[str, float], {"dynamic": None, **options}))

    def as_json(self) -> dict[str, object]:
        """The options that differ from the suite's, as values of JSON; equal for equal pictures."""
        values = {**dataclasses.asdict(self)}
        if self.background is None:
            for name in ("place", "clips", "order", "floor", "files"):
                values.pop(name)
        values["dynamic"] = [p for p in self.moving if getattr(self, p) is not None]
        if not values["dynamic"]:
            values.pop("interval")
            if not _dynamic(None, self.background):  # else it says that a background stands still
                values.pop("dynamic")
        return {name: value for name, value in values.items() if value is not None}

    @property
    def most_clips(self) -> int | None:
        """The number of videos to choose from; None for all."""
        return cast(int | None, self.clips)  # `__post_init__` has put the number there

    @property
    def source(self) -> tuple[str, str]:
        """The kind of the background, empty for the suite's, and its path, empty for noise."""
        kind, _, path = (self.background or "").partition(":")
        return kind, path

    @property
    def moving(self) -> tuple[str, ...]:
        """The parts that change within an episode."""
        assert isinstance(self.dynamic, tuple)
        return self.dynamic


def level(value: float | str | None) -> float:
    """An option of an `Appearance`, which has checked it, as a number; 0 for None."""
    return float(value or 0.0)


def _parsed(text: str) -> object:
    """The mapping of a text."""
    if text.lstrip().startswith("{"):
        try:
            return json.loads(text)
        except ValueError as error:
            raise ValueError(
                f"appearance is {text!r}, which is no JSON: {error}; expected a preset, or a "
                'mapping such as {"background": "noise", "colors": "hard"}'
            ) from error
    preset, _, background = text.partition("=")
    name, _, intensity = preset.partition(":")
    given = {"preset": name, "intensity": intensity, "background": background}
    return {option: value for option, value in given.items() if value or option == "preset"}


def _with_preset(given: AppearanceOptions) -> dict[str, object]:
    """The options of a mapping, with those of its preset."""
    options = dict(given)
    name, intensity = options.pop("preset", None), options.pop("intensity", None)
    if name is None:
        if intensity is not None:
            raise ValueError(
                f"appearance has intensity {intensity!r} without a preset; expected preset "
                "'distracting_cs' beside it"
            )
        return options
    if not isinstance(name, str) or name not in PRESETS:
        raise ValueError(
            f"appearance has no preset {name!r}.{did_you_mean(name, PRESETS)} Choose one of: "
            f"{', '.join(PRESETS)}."
        )
    preset = {**PRESETS[name], **_of_intensity(name, intensity)}
    text = f"{name}{'' if intensity is None else f':{intensity}'}=video:DIR"
    if name in _WITH_VIDEO and options.get("background") is None:
        raise ValueError(
            f"preset {name!r} needs videos, which are not included: give them as 'background', or "
            f"as in {text!r}; or 'noise' in their place"
        )
    return {**preset, **options}


def _of_intensity(name: str, intensity: object) -> dict[str, object]:
    """The options of an intensity of distracting_cs; nothing for other presets."""
    known = ", ".join(map(str, INTENSITIES))
    if name != "distracting_cs":
        if intensity is not None:
            raise ValueError(f"preset {name!r} has no intensity; got {intensity!r}")
        return {}
    try:
        scale = float(cast(str, intensity))  # what is no number raises
    except (TypeError, ValueError):
        scale = math.nan
    if scale not in INTENSITIES:
        raise ValueError(
            f"distracting_cs has no intensity {intensity!r}; expected one of {known}, as in "
            "'distracting_cs:0.1'"
        )
    return {"colors": scale, "camera": scale, "clips": INTENSITIES[scale]}


def _check_background(background: object) -> None:
    if background is None or background == "noise":
        return
    kind, _, path = background.partition(":") if isinstance(background, str) else ("", "", "")
    if kind not in _SOURCES[1:] or not path:
        raise ValueError(
            f"appearance's background is {background!r}; expected 'noise', 'images:DIR' or "
            f"'video:PATH'.{did_you_mean(kind, _SOURCES)}"
        )


def _one_of(name: str, value: object, choices: Sequence[str]) -> None:
    if value not in choices:
        expected = " or ".join(map(repr, choices))
        raise ValueError(
            f"appearance's {name} is {value!r}; expected {expected}.{did_you_mean(value, choices)}"
        )


def _bounded(name: str, value: object, names: Mapping[str, float], most: float) -> float | None:
    """The number that a value stands for."""
    if value is None:
        return None
    if isinstance(value, str) and value in names:
        return names[value]
    is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    number = float(cast(float, value)) if is_number else math.nan
    if 0.0 <= number <= most and number < math.inf:
        return number
    bound = f"from 0 to {most:g}" if math.isfinite(most) else "of at least 0"
    named = f"{', '.join(map(repr, names))}, or " if names else ""
    raise ValueError(
        f"appearance's {name} is {value!r}; expected {named}a number {bound}."
        f"{did_you_mean(value, names)}"
    )


def _clips(value: object) -> int | None:
    """The number of videos, None for all."""
    if value is None:
        return None
    if isinstance(value, str) and value in _CLIPS:
        return _CLIPS[value]
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if is_whole and int(cast(int, value)) >= 1:
        return int(cast(int, value))
    raise ValueError(
        f"appearance's clips is {value!r}; expected {', '.join(map(repr, _CLIPS))}, or a number of "
        f"at least 1.{did_you_mean(value, _CLIPS)}"
    )


def _dynamic(value: object, background: str | None) -> tuple[str, ...]:
    """The parts that change within an episode, in their order."""
    if value is None:
        moves = background is not None and not background.startswith("images")
        return _PARTS[:1] if moves else ()
    if isinstance(value, bool):
        return _PARTS if value else ()
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise TypeError(
            f"appearance's dynamic is {value!r}; expected True, False, or a list of some of: "
            f"{', '.join(_PARTS)}"
        )
    for part in value:
        if part not in _PARTS:
            raise ValueError(
                f"appearance's dynamic has {part!r}; expected some of: {', '.join(_PARTS)}."
                f"{did_you_mean(part, _PARTS)}"
            )
    return tuple(part for part in _PARTS if part in value)
