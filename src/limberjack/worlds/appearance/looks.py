"""`Looks`: the appearances of the rows of a batch, or of one simulation, drawn for each episode.

    looks = Looks(Appearance.of("color_hard"), num_envs=4, control_timestep=0.02)
    looks.begin(2, stream)      # an episode begins in row 2; the stream is not advanced
    look = looks.of(2)
    look.background(data.time)  # also `colors` and `place`, of this moment, and `turns`

A look depends on nothing but the state of the row's stream before its first episode, the number of
the episode, and the time in it. A row therefore looks as the single environment with its seed, and
as it did before it was saved. `mujoco.dressing` draws it.
"""

import dataclasses
import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from limberjack.worlds.appearance import media
from limberjack.worlds.appearance.backdrop import Noise, Shown
from limberjack.worlds.appearance.colors import ColorWalk, Palette, palette
from limberjack.worlds.appearance.options import Appearance, AppearanceOptions, level
from limberjack.worlds.appearance.viewpoint import CameraWalk, Sphere, rotation, shift

__all__ = ["Look", "Looks"]

_WORDS = 4  # of 32 bits: the seed of a row's looks
# The streams of an episode's look.
_COLORS, _PALETTE, _CAMERA, _ROTATE, _SHIFT, _BACKGROUND = range(6)
_ROUND_OFF = 1e-6  # control steps that the sum of time steps may lack


_SKY = 2  # MuJoCo's mjtTexture.mjTEXTURE_SKYBOX


class Looks:
    """See the module's docstring."""

    def __init__(self, options: Appearance, num_envs: int, control_timestep: float) -> None:
        """Finds the files of the background.

        Args:
          options: the appearance.
          num_envs: number of rows.
          control_timestep: seconds.

        Raises:
          ValueError, ImportError: see `media.find`.
        """
        kind, path = options.source
        if path:  # now, since a program may change its working directory
            path = os.path.abspath(os.path.expanduser(path))
            options = dataclasses.replace(options, background=f"{kind}:{path}")
        self.options = options
        try:
            self.clips = media.find(kind, path, options.most_clips) if path else []
        except ValueError as error:
            if options.files is None:
                raise
            raise ValueError(
                f"{error}; a result has the name of the folder alone: run this where the folder is"
            ) from None
        if options.files is not None and options.files != media.fingerprint(self.clips):
            raise ValueError(
                f"appearance's background {options.background} has other files than those with the "
                f"SHA-256 {options.files}: give the original ones, or leave out 'files'"
            )
        self._control_timestep = control_timestep
        self._seeds = np.zeros((num_envs, _WORDS), np.uint32)
        self._episodes = np.full(num_envs, -1)
        self._streams: list[np.random.RandomState | None] = [None] * num_envs
        self._looks: list[Look | None] = [None] * num_envs

    @classmethod
    def for_physics(
        cls,
        appearance: "AppearanceOptions | str | Appearance | None",
        physics: object,
        num_envs: int,
        control_timestep: float,
    ) -> "Looks | None":
        """Looks for a user's options; None for None.

        Args:
          appearance: the options; see `Appearance.of`.
          physics: a single simulation, whose model must have a sky if a background replaces it, and
            materials if colours change.
          num_envs: number of rows.
          control_timestep: seconds.

        Raises:
          ValueError, TypeError, ImportError: see `Appearance.of` and `__init__`; or the model has
            no sky or no materials; or the physics cannot be rendered.
        """
        if appearance is None:
            return None
        options = Appearance.of(appearance)
        model = getattr(getattr(physics, "model", None), "_official", None)
        if model is None or not hasattr(physics, "render_rows"):
            raise TypeError(
                f"a {type(physics).__name__} cannot be rendered; appearance needs a "
                "limberjack.mujoco.Physics"
            )
        if options.background is not None and _SKY not in model.tex_type:
            raise ValueError(
                "appearance has a background, but the model has no sky that it could replace: add "
                '<texture type="skybox" builtin="flat" width="8" height="8"/> to its assets'
            )
        if options.colors is not None and not model.nmat:
            raise ValueError(
                "appearance has colors, but the model has no material that could have another: add "
                "<material> elements to its assets and name them in its geoms, or give "
                '"colors": null beside the preset'
            )
        return cls(options, num_envs, control_timestep)

    @classmethod
    def of_rows(cls, single: "Looks | None", num_envs: int) -> "Looks | None":
        """Looks of many rows with the options of one simulation; None for None."""
        return None if single is None else cls(single.options, num_envs, single._control_timestep)

    def __getstate__(self) -> dict[str, object]:
        """The state without the looks, which are drawn again."""
        return {**vars(self), "_looks": [None] * len(self._looks)}

    def as_json(self) -> dict[str, object]:
        """The options as values of JSON, in which a hash stands for the place of files."""
        options, (kind, path) = self.options.as_json(), self.options.source
        if not path:
            return options
        name = {"background": f"{kind}:{Path(path).name}"}
        return {**options, **name, "files": media.fingerprint(self.clips)}

    def begin(self, row: int, stream: np.random.RandomState) -> None:
        """Draws the look of the row's next episode: the first one of a stream that is new."""
        if stream is not self._streams[row]:
            self._streams[row] = stream
            self._seeds[row], self._episodes[row] = _seed_beside(stream), -1
        self._episodes[row] += 1
        self._looks[row] = None

    def of(self, row: int) -> "Look | None":
        """The look of a row's episode; None before its first one."""
        if self._episodes[row] < 0:
            return None
        look = self._looks[row]
        if look is None:
            seed, episode = self._seeds[row].tolist(), int(self._episodes[row])
            look = Look(self.options, self.clips, self._control_timestep, seed, episode)
            self._looks[row] = look
        return look

    def save(self, rows: np.ndarray | None) -> dict[str, np.ndarray]:
        """Copies of what the looks of rows, None for all, are drawn from: (n, ...) each."""
        index = slice(None) if rows is None else rows
        return {"look": self._seeds[index].copy(), "look_episode": self._episodes[index].copy()}

    def load(
        self,
        saved: dict[str, np.ndarray],
        rows: np.ndarray | None,
        streams: Sequence[np.random.RandomState],
    ) -> None:
        """Restores the result of `save` into rows, which draw from these streams."""
        numbers = range(len(self._streams)) if rows is None else rows.tolist()
        for i, (row, stream) in enumerate(zip(numbers, streams, strict=True)):
            self._seeds[row] = saved["look"][i]
            self._episodes[row] = saved["look_episode"][i]
            self._streams[row] = stream if self._episodes[row] >= 0 else None
            self._looks[row] = None


class Look:
    """The appearance of an episode."""

    def __init__(
        self,
        options: Appearance,
        clips: Sequence[media.Clip],
        control_timestep: float,
        seed: Sequence[int],
        episode: int,
    ) -> None:
        """Draws what the model does not change; see `Looks`."""
        self.options = options
        self._control_timestep = control_timestep
        self._seed = [*seed, episode]
        self._walk: ColorWalk | None = None
        self._walks: dict[tuple[object, Sphere], CameraWalk] = {}
        self.palette: Palette | None = None
        if options.palette is not None:
            self.palette = palette(self._stream(_PALETTE), level(options.palette))
        self._background: Noise | Shown | None = None
        self._frame: tuple[int, np.ndarray] | None = None  # the last one, after so many changes
        moves = "background" in options.moving
        if clips and options.order == "next":
            self._background = Shown.next(seed[0] + episode, clips, moves)
        elif clips:
            self._background = Shown.random(self._stream(_BACKGROUND), clips, moves)
        elif options.background is not None:
            self._background = Noise(self._stream(_BACKGROUND))

    def colors(self, materials: np.ndarray, time: float) -> np.ndarray | None:
        """Colours of the materials, (n, 3), at a time, from those of the model; None for these."""
        if self.options.colors is None:
            return None
        changes, walk = self._changes("colors", time), self._walk
        is_other = walk is None or not np.array_equal(walk.original, materials)
        if walk is None or is_other or walk.changes > changes:
            how = level(self.options.colors), "colors" in self.options.moving
            walk = self._walk = ColorWalk(self._stream(_COLORS), materials, *how)
        return walk.at(changes)

    def place(self, camera: int, start: Sphere, time: float) -> tuple[Sphere, float] | None:
        """Place and roll of a camera at a time; None for the model's.

        Args:
          camera: its number.
          start: the place that the model gives it.
          time: seconds since the episode began.
        """
        if self.options.camera is None:
            return None
        changes, walk = self._changes("camera", time), self._walks.get((camera, start))
        if walk is None or walk.changes > changes:
            how = level(self.options.camera), "camera" in self.options.moving
            walk = CameraWalk(self._stream(_CAMERA, camera + 1), start, *how)
            self._walks[camera, start] = walk
        return walk.at(changes)

    def turns(self, name: str) -> list[np.ndarray]:
        """Matrices by which cameras of a model of this name are turned, (3, 3) each."""
        turns = []
        if self.options.shift is not None:
            turns.append(shift(self._stream(_SHIFT), name, level(self.options.shift)))
        if self.options.rotate is not None:
            turns.append(rotation(self._stream(_ROTATE), level(self.options.rotate)))
        return turns

    def background(self, time: float) -> np.ndarray | None:
        """The background at a time, (n, n, 3) uint8; None for the model's sky."""
        if self._background is None:
            return None
        changes = self._changes("background", time)
        if self._frame is None or self._frame[0] != changes:
            self._frame = changes, self._background.at(changes)
        return self._frame[1]

    def _changes(self, part: str, time: float) -> int:
        """The number of changes of a part until a time."""
        if part not in self.options.moving:
            return 0
        steps = int(time / self._control_timestep + _ROUND_OFF)
        return steps // self.options.interval

    def _stream(self, *numbers: int) -> np.random.RandomState:
        return np.random.RandomState(np.array([*self._seed, *numbers], np.uint32))


def _seed_beside(stream: np.random.RandomState) -> np.ndarray:
    """A seed from the state of a stream, which is not advanced, (4,) uint32."""
    _, key, position, *_ = stream.get_state(legacy=True)
    state = np.append(np.asarray(key, np.uint32), np.uint32(position))
    digest = hashlib.blake2b(state.tobytes(), digest_size=4 * _WORDS, person=b"appearance")
    return np.frombuffer(digest.digest(), "<u4").astype(np.uint32)
