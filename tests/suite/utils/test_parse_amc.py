"""Tests of limberjack.suite.utils.parse_amc; tests/oracle compares it with dm_control."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics
from limberjack.suite.utils import parse_amc

_ORDER = parse_amc._CMU_MOCAP_JOINT_ORDER
_TIMESTEP = 0.02


@pytest.fixture(scope="module")
def physics() -> Physics:
    return suite.load("humanoid_CMU", "stand", {"random": 0}).physics


def _write(path: Path, values: np.ndarray) -> Path:
    """A clip with all values of a frame, (frames, 62), in one line."""
    lines = ["#!OML:ASF", ":FULLY-SPECIFIED", ":DEGREES"]
    for number, frame in enumerate(values.tolist(), 1):
        lines += [str(number), f"all {' '.join(map(repr, frame))}"]
    path.write_text("\n".join(lines) + "\n")
    return path


def _clip(frames: int = 60) -> np.ndarray:
    """A clip in which each value is a cubic polynomial of time."""
    coefficients = np.random.RandomState(0).uniform(-20, 20, (4, len(_ORDER)))
    return np.vander(np.arange(frames) / 120, 4) @ coefficients


def test_the_values_of_a_frame_are_those_of_all_hinges_of_the_humanoid(physics: Physics) -> None:
    hinges = physics.named.data.qpos.axes.row.names[1:]
    assert len(_ORDER) == 62
    assert sorted(_ORDER[6:]) == sorted(hinges)
    assert _ORDER[:7] == (*(f"root{i}" for i in range(6)), "lowerbackrx")


def test_a_file_is_read_frame_by_frame(tmp_path: Path) -> None:
    file = tmp_path / "clip.amc"
    file.write_text(
        "#!OML:ASF\n:FULLY-SPECIFIED\n:DEGREES\n"
        "1\nroot 1 2.5 -3e0\nhead 4\n2\nroot 5 6 7\nhead 8\n\n3\nroot 9 9 9\nhead 9\n"
    )
    first, second, third = parse_amc.parse(file)
    np.testing.assert_array_equal(first, [1, 2.5, -3, 4])
    np.testing.assert_array_equal(second, [5, 6, 7, 8])
    np.testing.assert_array_equal(third, [9, 9, 9, 9])
    assert first.dtype == np.float64


def test_a_clip_becomes_positions_velocities_and_times(physics: Physics, tmp_path: Path) -> None:
    values = _clip()
    clip = parse_amc.convert(_write(tmp_path / "clip.amc", values), physics, _TIMESTEP)
    count = len(clip.time)
    np.testing.assert_allclose(clip.time, _TIMESTEP * np.arange(count))
    assert clip.time[-1] <= 59 / 120 < clip.time[-1] + _TIMESTEP
    assert clip.qpos.shape == (63, count)
    assert clip.qvel.shape == (62, count - 1)
    # Each hinge's cubic is its own spline.
    rows = np.vander(clip.time, 4) @ np.linalg.lstsq(np.vander(np.arange(60) / 120, 4), values)[0]
    for joint in ("headrx", "ltoesrx", "rhandrz"):
        index = physics.named.data.qpos.axes.row.convert_key_item(joint)
        angles = np.deg2rad(rows[:, _ORDER.index(joint)])
        np.testing.assert_allclose(np.squeeze(clip.qpos[index]), angles, atol=1e-9)
        dof = physics.named.data.qvel.axes.row.convert_key_item(joint)
        speeds = np.diff(angles) / _TIMESTEP
        np.testing.assert_allclose(np.squeeze(clip.qvel[dof]), speeds, atol=1e-7)
    # Height is the second value of the root.
    np.testing.assert_allclose(clip.qpos[2], rows[:, 1] * parse_amc.CONVERSION_LENGTH, atol=1e-9)


def test_a_pose_at_rest_keeps_its_place_exactly(physics: Physics, tmp_path: Path) -> None:
    file = _write(tmp_path / "clip.amc", np.tile(_clip(1) + 7.0, (30, 1)))
    clip = parse_amc.convert(file, physics, _TIMESTEP)
    np.testing.assert_array_equal(clip.qpos, np.tile(clip.qpos[:, :1], len(clip.time)))
    assert np.linalg.norm(clip.qpos[3:7, 0]) == pytest.approx(1)
    np.testing.assert_allclose(clip.qvel, 0, atol=1e-12)


def test_a_clip_can_be_set_as_the_state_of_the_humanoid(physics: Physics, tmp_path: Path) -> None:
    clip = parse_amc.convert(_write(tmp_path / "clip.amc", np.zeros((9, 62))), physics, _TIMESTEP)
    with physics.reset_context():
        physics.data.qpos[:] = clip.qpos[:, 0]
        physics.data.qvel[:] = clip.qvel[:, 0]
    # Zeros are the skeleton's pose in the file, upright: the database's y axis is up.
    upright = physics.named.data.xmat["root", ["zy"]]
    np.testing.assert_allclose(upright, 1, atol=1e-12)


@pytest.mark.parametrize("count", [4, 5, 6, 9])
def test_a_spline_through_a_cubic_is_the_cubic(count: int) -> None:
    x = np.cumsum(np.random.RandomState(count).uniform(0.5, 1.5, count))
    new_x = np.linspace(x[0], x[-1], 31)
    cubic = np.array([[1.0, -2.0, 0.5, 3.0], [0.0, 0.0, 0.0, 2.0]]).T
    y = parse_amc._spline(x, np.vander(x, 4) @ cubic, new_x)
    np.testing.assert_allclose(y, np.vander(new_x, 4) @ cubic, rtol=1e-12)


def test_a_spline_has_no_knots_beside_the_ends_and_is_smooth_at_the_others() -> None:
    x = np.array([0.0, 1.0, 2.5, 3.0, 4.5, 5.0, 6.0])
    y = np.random.RandomState(0).normal(size=(7, 1))
    np.testing.assert_allclose(parse_amc._spline(x, y, x), y, atol=1e-15)

    def cubics() -> list[np.ndarray]:
        inner = [np.linspace(start, end, 4) for start, end in itertools.pairwise(x)]
        values = [parse_amc._spline(x, y, each)[:, 0] for each in inner]
        return [np.polyfit(each, value, 3) for each, value in zip(inner, values, strict=True)]

    pieces = cubics()
    np.testing.assert_allclose(pieces[0], pieces[1], atol=1e-9)
    np.testing.assert_allclose(pieces[-1], pieces[-2], atol=1e-9)
    for knot, (left, right) in zip(x[1:-1], itertools.pairwise(pieces), strict=True):
        for order in (1, 2):
            slopes = [np.polyval(np.polyder(piece, order), knot) for piece in (left, right)]
            assert slopes[0] == pytest.approx(slopes[1], abs=1e-8)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the first line of .* is empty"),
        ("\n1\nroot 1\n", "the first line of .* is empty"),
        (":DEGREES\n", "has no frames"),
        (":DEGREES\n1\nroot 1 2\n", r"values of shape \(2,\); expected \(62,\)"),
        (":DEGREES\n1\nroot 1\n2\nroot x\n", "frame 2 of .*'x'; expected numbers"),
    ],
)
def test_a_file_that_is_no_clip_is_refused(
    text: str, message: str, physics: Physics, tmp_path: Path
) -> None:
    file = tmp_path / "clip.amc"
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        parse_amc.convert(file, physics, _TIMESTEP)


@pytest.mark.parametrize(
    ("frames", "timestep", "message"),
    [
        (3, 0.01, "has 3 frames; a cubic spline needs at least 4"),
        (6, 0, "timestep is 0; expected a positive number"),
        (6, -0.02, "timestep is -0.02; expected a positive number"),
        (6, np.nan, "timestep is nan; expected a positive number"),
        (6, 1, r"timestep is 1 s, and .* lasts 0\.04167 s"),
    ],
)
def test_short_clips_and_wrong_time_steps_are_refused(
    frames: int, timestep: float, message: str, physics: Physics, tmp_path: Path
) -> None:
    file = _write(tmp_path / "clip.amc", _clip(frames))
    with pytest.raises(ValueError, match=message):
        parse_amc.convert(file, physics, timestep)


def test_another_model_is_refused(tmp_path: Path) -> None:
    physics = suite.load("cartpole", "swingup", {"random": 0}).physics
    file = _write(tmp_path / "clip.amc", _clip())
    with pytest.raises(ValueError, match="2 positions; expected those of humanoid_CMU, 63"):
        parse_amc.convert(file, physics, _TIMESTEP)
