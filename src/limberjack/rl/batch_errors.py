"""What is said where a task is not batch-safe: one sentence each, with the change to make.

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

__all__ = ["Finding", "explained"]

_ADVICE = (
    "index with `...`, reduce over axis -1, and write np.maximum and np.where for max() and if"
)
# A constant of these is given to every row.
_MAY_BE_ONE = ("the reward", "reward term", "is_success")
# Of what a task calls: the mistake is in the last line outside of these.
_NOT_THE_TASKS = (
    Path(np.__file__).parent,
    Path(__file__).parents[1] / "utils",
    Path(__file__).parents[1] / "mujoco",
)


@dataclasses.dataclass(frozen=True)
class Finding:
    """A quantity of one row at one moment.

    Attributes:
      label: what it is, such as "observation 'angle'".
      task: the task's name.
      row: the row's number.
      step: steps since its start.
      num_rows: number of rows.
      kept: attributes of the task that starts set.
    """

    label: str
    task: str
    row: int
    step: int
    num_rows: int
    kept: Sequence[str] = ()

    def check(self, found: np.ndarray, expected: np.ndarray) -> None:
        """Raises ValueError unless the row has these values.

        Args:
          found: of all rows.
          expected: of a single simulation in the same state; NaN is equal to NaN.
        """
        shape = (self.num_rows, *expected.shape)
        if self.label == "get_termination" and found.shape == () and np.isnan(found):
            found = np.full(shape, np.nan)
        if found.shape == () == expected.shape and self.label.startswith(_MAY_BE_ONE):
            found = np.broadcast_to(found, shape)
        if found.shape != shape:
            raise ValueError(
                f"{self.label} of task {self.task} has shape {found.shape} in a batch of "
                f"{self.num_rows}; expected {shape}: {self._advice()}"
            )
        if self.label.startswith("observation") and found.dtype != expected.dtype:
            raise ValueError(
                f"{self.label} of task {self.task} has dtype {found.dtype} in a batch; expected "
                f"{expected.dtype}, as in a single simulation: {self._advice()}"
            )
        differs = _differing(found[self.row], expected)
        if differs.any():
            index = tuple(np.argwhere(differs)[0].tolist())
            where = f" at index {list(index)}" if index else ""
            raise ValueError(
                f"{self.label} of task {self.task} is {found[self.row][index].item()!r}{where} in "
                f"row {self.row} of a batch {self._moment()}; expected {expected[index].item()!r}, "
                f"as in a single simulation in the same state: {self._advice()}"
            )

    def missing(self, others: Sequence[str]) -> ValueError:
        """The error for what a single simulation has and the batch lacks."""
        return ValueError(
            f"{self.label} of task {self.task} is missing in a batch {self._moment()}, where there "
            f"are {', '.join(others)}: a task must give rows what it gives a single simulation"
        )

    def surplus(self) -> ValueError:
        """The error for what the batch has and a single simulation lacks."""
        return ValueError(
            f"{self.label} of task {self.task} is there in a batch {self._moment()}, but not in a "
            "single simulation: a task must give rows what it gives a single simulation"
        )

    def _moment(self) -> str:
        return f"after {self.step} steps" if self.step else "as episodes begin"

    def _advice(self) -> str:
        if self.kept:
            names = ", ".join(f"self.{name}" for name in self.kept)
            return (
                f"keep nothing of the episode in the task, whose start sets {names}, as all rows "
                "share it: what an episode needs lives in the data or the model"
            )
        if self.label.startswith(("data.", "model.")):
            return (
                "before_step and after_step must set each row's part of it; positions and mocap "
                "bodies can be set at an episode's start only"
            )
        return _ADVICE


@contextlib.contextmanager
def explained(
    what: str, task: str, num_rows: int, is_batch: bool = True, expected: Sequence[str] = ()
) -> Iterator[None]:
    """Turns an error that a task raises in a batch into one that says of what, and what to change.

    Args:
      what: is computed.
      task: the task's name.
      num_rows: number of rows.
      is_batch: False leaves errors as they are.
      expected: labels of what a single simulation shows, in their order.

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
        label = _observation_under_way(frames, names) or what
        raise ValueError(
            f"{label} of task {task} raises {type(error).__name__} in a batch of {num_rows} rows, "
            f"but not in a single simulation: {error} ({_place(error)}); {_ADVICE}"
        ) from error


def _observation_under_way(frames: Sequence[FrameType], labels: Sequence[str]) -> str | None:
    """The label of the observation that was being made; None if that cannot be seen.

    A `get_observation` fills a mapping item by item: the next one after those that are in it.
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
    """The last line that is the task's own, as "tip_height, line 7: `...`"."""
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
    """Where values differ; NaN is equal to NaN."""
    differs = np.asarray(found != expected)
    if found.dtype.kind == "f" and expected.dtype.kind == "f":
        differs &= ~(np.isnan(found) & np.isnan(expected))
    return differs
