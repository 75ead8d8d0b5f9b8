"""Motion capture of the CMU database, AMC files, as positions and velocities of humanoid_CMU.

    env = suite.load("humanoid_CMU", "stand")
    clip = parse_amc.convert("walk.amc", env.physics, env.control_timestep())
    with env.physics.reset_context():
        env.physics.data.qpos[:] = clip.qpos[:, 0]

A file has a header, then frames, 120 a second: the number of the frame, counted from 1, on a line
of its own, and a line for each bone with its name and values. The bones' names are not read: their
order is the one in which the database writes them. Positions at the time steps of an environment
are interpolated by a cubic spline. Names, arguments, results and kinds of errors are dm_control's.
"""

import collections
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike

import numpy as np

from limberjack.mujoco import Physics
from limberjack.mujoco import math as mjmath

__all__ = ["CONVERSION_LENGTH", "MOCAP_DT", "Amcvals2qpos", "Converted", "convert", "parse"]

MOCAP_DT = 1.0 / 120.0  # seconds between frames
CONVERSION_LENGTH = 0.056444  # metres; the database's unit is 1 / 0.45 inches

_ROOT_VALUES = 6  # position, then Euler angles in degrees
_TRUNK = "lowerback xyz, upperback xyz, thorax xyz, lowerneck xyz, upperneck xyz, head xyz"
_ARM = "clavicle yz, humerus xyz, radius x, wrist y, hand xz, fingers x, thumb xz"
_LEG = "femur xyz, tibia x, foot xz, toes x"


def _joints(bones: str, side: str = "") -> list[str]:
    """The joints of bones given as names and axes, such as `rhandrx` and `rhandrz`."""
    pairs = (bone.split() for bone in bones.split(", "))
    return [f"{side}{bone}r{axis}" for bone, axes in pairs for axis in axes]


# The values of a frame in order, by the names of humanoid_CMU's joints.
_CMU_MOCAP_JOINT_ORDER = (
    *(f"root{number}" for number in range(_ROOT_VALUES)),
    *_joints(_TRUNK),
    *_joints(_ARM, "r"),
    *_joints(_ARM, "l"),
    *_joints(_LEG, "r"),
    *_joints(_LEG, "l"),
)

Converted = collections.namedtuple("Converted", ["qpos", "qvel", "time"])
Converted.__doc__ = """A clip: `qpos` (nq, T), `qvel` (nv, T - 1) and `time` (T,), seconds."""


class _RefusedError(ValueError, IndexError, TypeError, ZeroDivisionError):
    """A wrong file or time step: a ValueError, and each kind that dm_control raises for one."""


def convert(file_name: str | PathLike[str], physics: Physics, timestep: float) -> Converted:
    """Positions and velocities of a clip at regular times, from its first frame on.

    Velocities are differences of successive positions over `timestep`. The components of the root's
    quaternion are interpolated one by one, so its norm is only close to 1.

    Args:
      file_name: an AMC file of at least four frames.
      physics: the physics of a task of humanoid_CMU; only the names of its joints are read.
      timestep: seconds between the times; at most the length of the clip.

    Returns:
      A `Converted`, with arrays of its own.

    Raises:
      ValueError: the file is not an AMC file of this skeleton, or has less than four frames, or
        `timestep` is not positive or too long.
      OSError: the file cannot be read.
    """
    frames = parse(file_name)
    to_qpos = Amcvals2qpos(_joint_of_each_position(physics), _CMU_MOCAP_JOINT_ORDER)
    if not frames:
        raise ValueError(f"{file_name} has no frames; expected an AMC file with a frame 1")
    positions = np.stack([to_qpos(frame) for frame in frames])
    frame_times = np.arange(len(frames)) * MOCAP_DT
    times = _times(frame_times, timestep)
    if len(frames) < 4:
        raise _RefusedError(
            f"{file_name} has {len(frames)} frames; a cubic spline needs at least 4"
        )
    if len(times) < 2:
        raise ValueError(
            f"timestep is {timestep} s, and {file_name} lasts {frame_times[-1]:.4g} s; expected a "
            "shorter time step"
        )
    qpos = _spline(frame_times, positions, times).T
    return Converted(qpos, _velocities(qpos, timestep), times)


def _joint_of_each_position(physics: Physics) -> dict[int, str]:
    """The name of the joint that each element of `qpos` belongs to."""
    axis = physics.named.data.qpos.axes.row
    joints = {}
    for name in axis.names:
        indices = axis.convert_key_item(name)
        if isinstance(indices, slice):
            joints.update(dict.fromkeys(range(indices.start, indices.stop), name))
        else:
            joints[indices] = name
    return joints


def _times(frame_times: np.ndarray, timestep: float) -> np.ndarray:
    """The multiples of `timestep` up to the last frame."""
    if not 0 < timestep < math.inf:
        raise _RefusedError(f"timestep is {timestep}; expected a positive number of seconds")
    times = np.arange(0, len(frame_times) * MOCAP_DT, timestep)
    return times[times <= frame_times[-1]]


def _velocities(qpos: np.ndarray, timestep: float) -> np.ndarray:
    """Differences of successive positions, (nq, T), over the time step: (nv, T - 1)."""
    before, after = qpos[:, :-1], qpos[:, 1:]
    turns = [
        mjmath.mj_quat2vel(mjmath.mj_quatdiff(source, target), timestep)
        for source, target in zip(before[3:7].T, after[3:7].T, strict=True)
    ]
    change = (after - before) / timestep
    return np.concatenate([change[:3], np.transpose(turns), change[7:]])


def _spline(x: np.ndarray, y: np.ndarray, new_x: np.ndarray) -> np.ndarray:
    """The not-a-knot cubic spline through (x, y), evaluated at `new_x` within its range.

    It is one cubic on the first two intervals, and one on the last two, as SciPy's `splrep`. The
    unknowns are the slopes: https://en.wikipedia.org/wiki/Cubic_Hermite_spline

    Args:
      x: (M,), ascending, M at least 4.
      y: (M, k).
      new_x: (T,).

    Returns:
      (T, k).
    """
    width = np.diff(x)
    secant = np.diff(y, axis=0) / width[:, None]
    slope = _slopes(width, secant)
    i = np.clip(np.searchsorted(x, new_x, side="right") - 1, 0, len(width) - 1)
    h = width[i, None]
    t = (new_x - x[i])[:, None]
    quadratic = (3 * secant[i] - 2 * slope[i] - slope[i + 1]) / h
    cubic = (slope[i] + slope[i + 1] - 2 * secant[i]) / h**2
    return y[i] + t * (slope[i] + t * (quadratic + t * cubic))


def _slopes(width: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """The slopes at the M points, (M, k), by elimination in a tridiagonal system.

    Its rows state that the second derivative is continuous at the points within, and the third
    derivative at the second point and at the last but one.
    """
    lower = np.r_[0.0, width[1:], width[-1] + width[-2]]
    diagonal = np.r_[width[1], 2 * (width[:-1] + width[1:]), width[-2]]
    upper = np.r_[width[0] + width[1], width[:-1], 0.0]
    w = width[:, None]
    within = 3 * (w[1:] * secant[:-1] + w[:-1] * secant[1:])
    first, last = _at_end(width, secant), _at_end(width[::-1], secant[::-1])
    slope = np.vstack((first, within, last))
    for row in range(1, len(slope)):
        factor = lower[row] / diagonal[row - 1]
        diagonal[row] -= factor * upper[row - 1]
        slope[row] -= factor * slope[row - 1]
    slope[-1] /= diagonal[-1]
    for row in range(len(slope) - 2, -1, -1):
        slope[row] = (slope[row] - upper[row] * slope[row + 1]) / diagonal[row]
    return slope


def _at_end(width: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """The right side of the equation for the first point, (k,)."""
    both = width[0] + width[1]
    return ((width[0] + 2 * both) * width[1] * secant[0] + width[0] ** 2 * secant[1]) / both


def parse(file_name: str | PathLike[str]) -> list[np.ndarray]:
    """The values of each frame, as they are in the file: (62,) each for a clip of the database.

    The header ends, as dm_control finds it, at the first line that begins with 1, and each frame at
    the number of the next one or at an empty line. An empty line outside a frame ends the file.

    Raises:
      ValueError: a value is not a number, or the first line is empty; then also an IndexError.
      OSError: the file cannot be read.
    """
    with open(file_name, encoding="utf-8") as file:
        lines = itertools.chain(map(str.strip, file), itertools.repeat(""))
        return list(_frames(lines, file_name))


def _frames(lines: Iterator[str], file_name: str | PathLike[str]) -> Iterator[np.ndarray]:
    line = next(lines)
    if not line:
        raise _RefusedError(f"the first line of {file_name} is empty; expected an AMC file")
    number = 1
    while True:
        if line == str(number) or (number == 1 and line.startswith("1")):
            number += 1
            words: list[str] = []
            while (line := next(lines)) and line != str(number):
                words += line.split()[1:]
            yield _values(words, number - 1, file_name)
        else:
            line = next(lines)
            if not line:
                return


def _values(words: Sequence[str], frame: int, file_name: str | PathLike[str]) -> np.ndarray:
    try:
        return np.array(words, dtype=float)
    except ValueError as error:
        raise ValueError(f"frame {frame} of {file_name}: {error}; expected numbers") from None


class Amcvals2qpos:
    """A converter from the values of a frame to `qpos`.

    Attributes:
      qpos_root_xyz_ind: the elements of `qpos` with the root's position.
      qpos_root_quat_ind: those with its quaternion.
      root_xyz_ransform: (3, 3), from a position in the database's unit, y up, to metres, z up; the
        spelling is dm_control's.
      amc2qpos_transform: (nq, count of values), 1 where a joint's angle is, otherwise 0.
    """

    def __init__(
        self, index2joint: Mapping[int, str] | Sequence[str], joint_order: Sequence[str]
    ) -> None:
        """Creates a converter.

        Args:
          index2joint: the joint of each element of `qpos`.
          joint_order: the joint of each value of a frame. Joints are hinges if their names contain
            rx, ry or rz; other values are not used, except for the first six, the root's.
        """
        self.qpos_root_xyz_ind = [0, 1, 2]
        self.root_xyz_ransform = CONVERSION_LENGTH * np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        self.qpos_root_quat_ind = [3, 4, 5, 6]
        joints = [index2joint[element] for element in range(len(index2joint))]
        self.amc2qpos_transform = np.zeros((len(joints), len(joint_order)))
        for row, joint in enumerate(joints):
            if any(axis in joint for axis in ("rx", "ry", "rz")):
                self.amc2qpos_transform[row] = [joint == name for name in joint_order]

    def __call__(self, amc_val: np.ndarray) -> np.ndarray:
        """`qpos`, (nq,), of the values of a frame: degrees, and the root's position.

        Raises:
          ValueError: another number of values than the converter was created for, or a model
            without a free root.
        """
        nq, count = self.amc2qpos_transform.shape
        if np.shape(amc_val) != (count,):
            raise _RefusedError(
                f"a frame has values of shape {np.shape(amc_val)}; expected ({count},)"
            )
        if nq <= max(self.qpos_root_quat_ind):
            raise _RefusedError(f"the model has {nq} positions; expected those of humanoid_CMU, 63")
        qpos = np.dot(self.amc2qpos_transform, np.deg2rad(amc_val))
        qpos[:3] = np.dot(self.root_xyz_ransform, amc_val[:3])
        z_up = mjmath.euler2quat(90, 0, 0)
        qpos[self.qpos_root_quat_ind] = mjmath.mj_quatprod(z_up, mjmath.euler2quat(*amc_val[3:6]))
        return qpos
