"""`suite.utils.parse_amc` reads clips as dm_control, whose spline is SciPy's."""

import contextlib
import functools
import inspect
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from . import clips
from .oracle import BOTH, ours, theirs
from .same import assert_same, assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

_NAME = "suite.utils.parse_amc"
# SciPy solves for coefficients of B-splines, ours for slopes: both round in the last bit or two of
# the greatest position, and velocities divide that by the time step.
_ROUNDING = 5e-15

_ROOT = "<body><freejoint name='root'/><geom size='1'/></body>"
_MODELS = {
    "no free root": "<body><joint name='headrx'/><joint name='a' axis='0 1 0'/><geom size='1'/>"
    "</body>",
    "a free body": _ROOT,
    "a joint without a name": f"{_ROOT}<body><joint/><geom size='1'/></body>",
    "some of the joints": f"{_ROOT}<body><joint name='rhandrx'/><joint name='headry'/>"
    "<geom size='1'/></body>",
}


@pytest.fixture(autouse=True)
def files_are_closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Closes the files of dm_control's `parse`, which leaves them open: a ResourceWarning."""
    with contextlib.ExitStack() as files:

        def open_until_the_end(*args: Any) -> IO[Any]:
            return files.enter_context(open(*args))

        monkeypatch.setattr(theirs(_NAME), "open", open_until_the_end, raising=False)
        yield


@functools.cache
def _humanoids() -> tuple[Any, Any]:
    first, second = (package("suite.humanoid_CMU").stand().physics for package in BOTH)
    return first, second


@functools.cache
def _physics(model: str) -> tuple[Any, Any]:
    xml = f"<mujoco><worldbody>{_MODELS[model]}</worldbody></mujoco>"
    first, second = (package("mujoco").Physics.from_xml_string(xml) for package in BOTH)
    return first, second


def _converted(file: Any, timestep: Any, both: tuple[Any, Any]) -> list[functools.partial]:
    return [
        functools.partial(package(_NAME).convert, file, physics, timestep)
        for package, physics in zip(BOTH, both, strict=True)
    ]


def _assert_same_clips(file: Path, timestep: Any, both: tuple[Any, Any]) -> None:
    mine, yours = (call() for call in _converted(file, timestep, both))
    assert type(mine).__name__ == type(yours).__name__
    assert mine._fields == yours._fields
    assert_same(mine.time, yours.time, f"{file}, time step {timestep}")
    greatest = max(1.0, np.abs(yours.qpos).max())
    for field, tolerance in (("qpos", _ROUNDING), ("qvel", _ROUNDING / timestep)):
        actual, expected = getattr(mine, field), getattr(yours, field)
        assert actual.dtype == expected.dtype
        np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * greatest)


def _public(module: Any) -> dict[str, Any]:
    names = [name for name in vars(module) if not name.startswith("_") and name != "open"]
    return {name: value for name in names if not inspect.ismodule(value := getattr(module, name))}


def test_every_public_name_is_there_with_the_same_arguments() -> None:
    assert set(ours(_NAME).__all__) == set(_public(theirs(_NAME)))
    for name in ("convert", "parse", "Amcvals2qpos"):
        arguments = [list(inspect.signature(getattr(p(_NAME), name)).parameters) for p in BOTH]
        assert arguments[0] == arguments[1], name


@pytest.mark.parametrize("name", ["MOCAP_DT", "CONVERSION_LENGTH", "_CMU_MOCAP_JOINT_ORDER"])
def test_constants_are_the_same(name: str) -> None:
    assert_same_pair([getattr(package(_NAME), name) for package in BOTH], name)


def test_the_clip_that_dm_control_ships_is_the_same() -> None:
    file = Path(theirs("suite").__file__ or "").parent / "demos" / "zeros.amc"
    assert_same_pair([package(_NAME).parse(str(file)) for package in BOTH], "zeros.amc")
    for timestep in (0.02, 0.01, 1 / 120):
        _assert_same_clips(file, timestep, _humanoids())


@pytest.mark.parametrize("kind", clips.KINDS)
@pytest.mark.parametrize("frames", [4, 5, 6, 7, 20, 500])
def test_clips_of_every_length_are_the_same(kind: str, frames: int, tmp_path: Path) -> None:
    file = tmp_path / "clip.amc"
    file.write_text(clips.text_of(clips.clip(kind, frames, seed=frames)))
    assert_same_pair([package(_NAME).parse(file) for package in BOTH], kind)
    for timestep in (0.02, 0.01, 1 / 120, 0.0077, np.float32(0.005), 0.001):
        _assert_same_clips(file, timestep, _humanoids())


def test_positions_and_velocities_at_a_control_time_step_agree_to_twelve_digits(
    tmp_path: Path,
) -> None:
    file = tmp_path / "clip.amc"
    for seed in range(5):
        file.write_text(clips.text_of(clips.clip("waves", 240, seed)))
        mine, yours = (call() for call in _converted(file, 0.02, _humanoids()))
        np.testing.assert_allclose(mine.qpos, yours.qpos, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(mine.qvel, yours.qvel, rtol=1e-12, atol=1e-12)


_LINES = [
    "1", "2", "3", "4", "10", "12", "", "  ", "\t", "root 1 2 3", "head 4", ":DEGREES", "# 1",
    "head nan", "head x", "head 1e3 -2", "1 7", "2 8", "1st 3", "head 1_0", " 2 ", "3\r", "a\t5\t6",
]  # fmt: skip


def test_malformed_files_are_read_or_refused_alike(tmp_path: Path) -> None:
    file = tmp_path / "clip.amc"
    random = np.random.RandomState(0)
    for _ in range(500):
        lines = [_LINES[i] for i in random.randint(len(_LINES), size=random.randint(12))]
        file.write_bytes("\n".join(lines).encode())
        assert_same_outcome(
            [functools.partial(package(_NAME).parse, file) for package in BOTH], repr(lines)
        )


def test_files_that_cannot_be_read_raise_the_same_errors(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"\xff\xfe\n1\nroot 1\n")
    for name in [tmp_path / "none.amc", tmp_path, tmp_path / "binary", None, 5.5]:
        calls = [functools.partial(package(_NAME).parse, name) for package in BOTH]
        assert assert_same_outcome(calls, f"parse({name})") is not None


@pytest.mark.parametrize("timestep", [0, 0.0, -1, -0.02, np.nan, np.inf, "a", 1, 0.5, 5 / 120])
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 6])
def test_wrong_time_steps_and_short_clips_are_refused_alike(
    frames: int, timestep: Any, tmp_path: Path
) -> None:
    file = tmp_path / "clip.amc"
    file.write_text(clips.text_of(clips.clip("waves", frames)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        calls = _converted(file, timestep, _humanoids())
        results = [functools.partial(_shapes, call) for call in calls]
        error = assert_same_outcome(results, f"{frames} frames, time step {timestep}")
    assert error is None or isinstance(error, ValueError) or timestep == "a"


def _shapes(call: Any) -> list[tuple[int, ...]]:
    return [array.shape for array in call()]


@pytest.mark.parametrize("values", [0, 1, 61, 63])
def test_a_clip_of_another_skeleton_is_refused_alike(values: int, tmp_path: Path) -> None:
    file = tmp_path / "clip.amc"
    file.write_text(clips.text_of(np.ones((6, values))))
    error = assert_same_outcome(_converted(file, 0.02, _humanoids()), f"{values} values")
    assert isinstance(error, ValueError)
    file.write_text(":DEGREES\n")
    error = assert_same_outcome(_converted(file, 0.02, _humanoids()), "no frames")
    assert isinstance(error, ValueError)


@pytest.mark.parametrize("model", _MODELS)
def test_other_models_are_converted_or_refused_alike(model: str, tmp_path: Path) -> None:
    file = tmp_path / "clip.amc"
    file.write_text(clips.text_of(clips.clip("waves", 50)))
    both = _physics(model)
    if model in ("no free root", "a joint without a name"):
        assert assert_same_outcome(_converted(file, 0.02, both), model) is not None
        return
    _assert_same_clips(file, 0.02, both)


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_values_that_are_not_finite_spread_alike(value: str, tmp_path: Path) -> None:
    values = clips.clip("waves", 30)
    values[7, 20] = float(value)
    file = tmp_path / "clip.amc"
    file.write_text(clips.text_of(values))
    with np.errstate(all="ignore"):
        mine, yours = (call() for call in _converted(file, 0.02, _humanoids()))
    np.testing.assert_array_equal(np.isnan(mine.qpos), np.isnan(yours.qpos))
    np.testing.assert_array_equal(np.isnan(mine.qvel), np.isnan(yours.qvel))


_SEVEN = ["root"] * 7


@pytest.mark.parametrize(
    ("index2joint", "joint_order"),
    [
        (_SEVEN, theirs(_NAME)._CMU_MOCAP_JOINT_ORDER),
        (
            [*_SEVEN, "headrx", "foo", "barry"],
            ["a", "b", "c", "d", "e", "f", "barry", "foo", "headrx", "headrx"],
        ),
        (dict(enumerate([*_SEVEN, "lradiusrz"])), ("a", "b", "c", "d", "e", "lradiusrz")),
        ({0: "headrx"}, ["headrx"]),
        ({1: "a"}, ["b"]),
        ([], []),
    ],
)
def test_a_converter_of_frames_is_the_same(index2joint: Any, joint_order: Any) -> None:
    makers = [
        functools.partial(package(_NAME).Amcvals2qpos, index2joint, joint_order) for package in BOTH
    ]
    error = assert_same_outcome([lambda make=make: vars(make()) for make in makers], "attributes")
    if error is not None:
        return
    count = len(joint_order)
    frames = [np.arange(count) * 10.0, list(range(count)), np.arange(count).astype(np.float32)]
    frames += [np.ones(3), [], 5, None, "abc", np.ones((1, count))]
    for frame in frames:
        calls = [functools.partial(make(), frame) for make in makers]
        assert_same_outcome(calls, f"frame {frame!r}")
