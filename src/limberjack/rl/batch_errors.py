"""Error messages for tasks that are not batch-safe, each with the change to make.

with explained("the reward", "SwingUp", num_rows=4):
    task.get_reward(physics)
Finding("the reward", "SwingUp", row=1, step=2, num_rows=4).check(found, expected)
"""

import contextlib
import dataclasses
import linecache
import traceback
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType

import numpy as np

__all__ = ["ADVICE", "Finding", "NotVectorised", "explained", "raised_in_a_batch", "wrong_shape"]

ADVICE = (
    "index with `...`, reduce over axis -1, and write np.maximum and np.where for max() and if: "
    "x[..., 0] for x[0], arrays.norm(x) of limberjack.utils for np.linalg.norm(x), "
    "x.all(axis=-1) for all(x), and x for float(x)"
)
# Quantities that may be a scalar in a batch, which is broadcast to every row.
_MAY_BE_ONE = ("the reward", "reward term", "is_success")
# Code that tasks call; the mistake is in the last traceback line outside of it.
_NOT_THE_TASKS = (
    Path(np.__file__).parent,
    Path(__file__).parents[1] / "utils",
    Path(__file__).parents[1] / "mujoco",
)


class NotVectorised(ValueError):  # noqa: N818 (an answer, not a fault of the code)
    """A task or an environment gives other numbers in a vectorised batch than alone."""

    advice = ""  # added to the message

    def __str__(self) -> str:
        return f"{super().__str__()}{self.advice}"


@dataclasses.dataclass(frozen=True)
class Finding:
    """A quantity of one row after a given step.

    Attributes:
      label: the quantity, such as "observation 'angle'".
      task: the task's name.
      row: the row's number.
      step: steps since the start of the episode.
      num_rows: number of rows.
    """

    label: str
    task: str
    row: int
    step: int
    num_rows: int

    def check(self, found: np.ndarray, expected: np.ndarray) -> None:
        """Raises ValueError unless the row has the expected values.

        Args:
          found: values of all rows.
          expected: values of a single simulation in the same state; NaN equals NaN.
        """
        shape = (self.num_rows, *expected.shape)
        if self.label == "get_termination" and found.shape == () and np.isnan(found):
            found = np.full(shape, np.nan)
        if found.shape == () == expected.shape and self.label.startswith(_MAY_BE_ONE):
            found = np.broadcast_to(found, shape)
        if found.shape != shape:
            raise wrong_shape(f"{self.label} of task {self.task}", found.shape, shape)
        if self.label.startswith("observation") and found.dtype != expected.dtype:
            raise NotVectorised(
                f"{self.label} of task {self.task} has dtype {found.dtype} in a batch; expected "
                f"{expected.dtype}, as in a single simulation: {self._advice()}"
            )
        differs = _differing(found[self.row], expected)
        if differs.any():
            index = tuple(np.argwhere(differs)[0].tolist())
            where = f" at index {list(index)}" if index else ""
            raise NotVectorised(
                f"{self.label} of task {self.task} is {found[self.row][index].item()!r}{where} in "
                f"row {self.row} of a batch {self._time()}; expected {expected[index].item()!r}, "
                f"as in a single simulation in the same state: {self._advice()}"
            )

    def check_measurement(self, found: np.ndarray, expected: np.ndarray) -> None:
        """Raises ValueError if what a method of the physics measures is certainly wrong.

        A method may return a constant of the model, or arrange an array as it likes. It may not
        return one value for all rows where they differ, nor wrong numbers.

        Args:
          found: value in a batch.
          expected: value in a single simulation in the state of this row.
        """
        is_one_for_all = found.shape == expected.shape
        is_number_per_row = expected.shape == () and found.shape == (self.num_rows,)
        if is_number_per_row or (is_one_for_all and _differing(found, expected).any()):
            self.check(found, expected)

    def missing(self, others: Sequence[str]) -> ValueError:
        """The error for a quantity that a single simulation has and the batch lacks."""
        return NotVectorised(
            f"{self.label} of task {self.task} is missing in a batch {self._time()}, which has "
            f"only {', '.join(others)}: a task must have the same quantities in a batch as in a "
            "single simulation"
        )

    def surplus(self) -> ValueError:
        """The error for a quantity that the batch has and a single simulation lacks."""
        return NotVectorised(
            f"{self.label} of task {self.task} exists in a batch {self._time()}, but not in a "
            "single simulation: a task must have the same quantities in both"
        )

    def _time(self) -> str:
        return f"after {self.step} steps" if self.step else "as episodes begin"

    def _advice(self) -> str:
        if self.label.startswith(("data.", "model.")):
            return (
                "before_step and after_step must set it for each row separately, and call "
                "physics.forward() after setting positions, velocities, mocap bodies or the model"
            )
        return ADVICE


@contextlib.contextmanager
def explained(
    what: str, task: str, num_rows: int, is_batch: bool = True, expected: Sequence[str] = ()
) -> Iterator[None]:
    """Replaces an error that a task raises in a batch by one with the quantity and advice.

    Args:
      what: the quantity being computed.
      task: the task's name.
      num_rows: number of rows.
      is_batch: if False, errors are not replaced.
      expected: labels of a single simulation's quantities, in order.

    Raises:
      ValueError: for any TypeError, ValueError, LookupError, AttributeError or ArithmeticError.
    """
    try:
        yield
    except (TypeError, ValueError, LookupError, AttributeError, ArithmeticError) as error:
        if not is_batch:
            raise
        frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
        names = [label for label in expected if label.startswith("observation ")]
        label = _current_observation(frames, names) or what
        raise raised_in_a_batch(f"{label} of task {task}", error, num_rows) from error


def raised_in_a_batch(what: str, error: BaseException, num_rows: int) -> NotVectorised:
    """The error for code that raised in a batch, and does not in a single simulation."""
    return NotVectorised(
        f"{what} raises {type(error).__name__} in a batch of {num_rows} rows, but not in a single "
        f"simulation: {error} ({_place(error)}); {ADVICE}"
    )


def wrong_shape(what: str, found: tuple[int, ...], expected: tuple[int, ...]) -> NotVectorised:
    """The error for a quantity of another shape than one value for each row demands."""
    return NotVectorised(
        f"{what} has shape {found} in a batch of {expected[0]}; expected {expected}: {ADVICE}"
    )


def _current_observation(frames: Sequence[FrameType], labels: Sequence[str]) -> str | None:
    """The label of the observation that was being computed; None if it cannot be inferred.

    A `get_observation` fills a mapping item by item, so the next missing item is the current one.
    """
    best: int | None = None
    for frame in frames:
        if frame.f_code.co_name == "get_observation" and labels:
            for value in frame.f_locals.values():
                if isinstance(value, Mapping):
                    made = [f"observation {name!r}" for name in value]
                    if made == labels[: len(made)] and len(made) < len(labels):
                        best = max(best or 0, len(made))
    return None if best is None else labels[best]


def _place(error: BaseException) -> str:
    """The last traceback line in the task's own code, as "tip_height, line 7: `...`"."""
    entries = [
        (frame.f_code, number)
        for frame, number in traceback.walk_tb(error.__traceback__)
        if Path(frame.f_code.co_filename) != Path(__file__)
    ]
    own = [
        (code, number)
        for code, number in entries
        if not any(Path(code.co_filename).is_relative_to(folder) for folder in _NOT_THE_TASKS)
    ]
    code, number = (own or entries)[-1]
    line = linecache.getline(code.co_filename, number).strip()
    return f"{code.co_name}, line {number}" + (f": `{line}`" if line else "")


def _differing(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Mask of differing values; NaN equals NaN."""
    differs = np.asarray(found != expected)
    if found.dtype.kind == "f" and expected.dtype.kind == "f":
        differs &= ~(np.isnan(found) & np.isnan(expected))
    return differs
