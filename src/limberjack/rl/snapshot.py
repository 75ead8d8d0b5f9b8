"""`Snapshot`: everything that the future of an environment depends on.

    snapshot = env.snapshot()          # a single environment, or a batch
    env.restore(snapshot)              # the same future, bit for bit
    batch.restore(row, rows=[3])       # one row into any row

It holds the integration state with the solver's warm start, the model fields set at an episode's
start, step counters, pending resets, random streams, the most recent pictures, and what a task
outside the suite remembers. An environment that overrides methods, has attributes of its own or
edits its model is held as a deep copy. It is a plain object that can be pickled and restored in
another process, with another patch version of MuJoCo and into a batch with another number of
threads. It holds neither the task's settings nor the model, whose numbers must match. The snapshot
is validated completely before anything is restored.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import dm_env
import numpy as np

from limberjack.rl.contract import SimulatedPhysics, Task
from limberjack.rl.copies import control_of
from limberjack.rl.memory import Memory
from limberjack.rl.represented import Description, represented
from limberjack.rl.streams import States
from limberjack.worlds import World

__all__ = ["Snapshot", "as_snapshot", "origin_of"]

_VERSION, _NUMBERS = "MuJoCo", "numbers of the model"
_KEY_LENGTH = 624  # numbers of a RandomState's key, of which its position counts the used ones
# Types of a snapshot's parts on which its checks rely.
_KINDS: dict[str, type] = {"origin": dict, "physics": dict, "streams": list, "frames": dict}
_KINDS |= {"memory": list, "copies": list, "faults": dict}


@dataclasses.dataclass(frozen=True)
class Snapshot:
    """State of n environments of one task.

    Attributes:
      origin: task, model and version, which must match when restoring.
      physics: the physics' arrays by name, (n, ...) each.
      step_count: steps since each episode began, (n,).
      begins: whether each one's next step begins an episode, (n,).
      streams: states of each one's `RandomState`s: the task's and, if any, the randomisation's.
      frames: stacks of pictures, by name, (n, ...) each; empty without pixels.
      registration: the suite's record of the domain, whose module is imported by unpickling.
      name: of the task, such as 'humanoid:walk'; empty for one that `suite.load` did not make.
      memory: what each one's task and physics remember; empty if the task is the suite's.
      copies: deep copies of the environments, if these are not plain; the arrays are then empty.
      limits: the step limit of each one's present episode, and the share of the limit that its
        next one takes, (n, 2); None unless the first episodes of a batch are staggered.
      observations: the last ones beside such copies, by name, (n, ...) each; may be empty.
      resets: whether such a copy begins its next episode by `reset`, not `step`, (n,); or empty.
      faults: what each one remembers of its faults, by name, (n, ...) each; empty without faults.
    """

    origin: dict[str, object]
    physics: dict[str, np.ndarray]
    step_count: np.ndarray
    begins: np.ndarray
    streams: list[States]
    frames: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    registration: object = None
    name: str = ""
    memory: list[Memory] = dataclasses.field(default_factory=list)
    copies: list[dm_env.Environment] = dataclasses.field(default_factory=list)
    observations: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    resets: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, bool))
    limits: np.ndarray | None = None
    faults: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)

    @classmethod
    def of_copy(
        cls, env: dm_env.Environment, registration: object = None, name: str = ""
    ) -> "Snapshot":
        """The snapshot of an environment as a copy of it.

        Args:
          env: the copy, of a user's class.
          registration: the suite's record of the domain.
          name: of the task.
        """
        return cls(
            cls.origin_of_copy(env),
            {},
            np.array([getattr(env, "_step_count", 0)]),
            np.array([bool(getattr(env, "_reset_next_step", False))]),
            [()],
            registration=registration,
            name=name,
            copies=[env],
        )

    @staticmethod
    def origin_of_copy(env: dm_env.Environment) -> dict[str, object]:
        """Facts that must match for a copy of an environment to be restored."""
        origin: dict[str, object] = {"environment": _class_of(env)}
        inner = control_of(env)
        if inner is None:
            return origin
        identity = getattr(getattr(inner, "physics", None), "identity", dict)()
        return {
            **origin,
            "task": type(getattr(inner, "task", None)).__name__,
            **{what: fact for what, fact in identity.items() if what != _NUMBERS},
        }

    def part(self, rows: int | np.ndarray) -> "Snapshot":
        """The snapshot of one of the environments, or of some, by number.

        Raises:
          IndexError: there are fewer environments.
        """
        numbers = np.atleast_1d(rows)
        parts = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            # An empty array or list stands for nothing, whatever the size.
            if isinstance(value, np.ndarray):
                parts[field.name] = value[numbers] if len(value) else value
            elif isinstance(value, list):
                parts[field.name] = [value[row] for row in numbers] if value else []
            elif isinstance(value, dict) and field.name != "origin":
                parts[field.name] = {name: array[numbers] for name, array in value.items()}
        return dataclasses.replace(self, **parts)

    def __repr__(self) -> str:
        task = self.name or str(self.origin.get("task"))
        return represented(
            self, Description(task, len(self), (), np.ravel(self.step_count).tolist())
        )

    def __len__(self) -> int:
        return len(self.streams)

    def check_all(self, own: "Snapshot", size: int, step_limit: float = math.inf) -> None:
        """Raises ValueError unless this can be restored.

        Args:
          own: a snapshot of the environment or batch to restore it into, of any number of rows.
          size: number of environments that this must hold.
          step_limit: steps per episode.
        """
        self.check(own.origin, size)
        if own.copies and not self.copies:
            raise ValueError(
                "the snapshot holds states of plain environments; expected copies of environments, "
                "as in a snapshot of this environment; nothing was restored"
            )
        for name, given in (("memory", self.memory), ("copies", self.copies)):
            if len(given) not in (0, size):
                raise ValueError(
                    f"the snapshot holds {len(given)} {name} for {size} environments; nothing was "
                    "restored"
                )
        for one in self.copies:
            if _class_of(one) != self.origin["environment"]:
                raise ValueError(
                    f"the snapshot holds a copy of a {_class_of(one)}; expected a "
                    f"{self.origin['environment']}; nothing was restored"
                )
        self._check_counters()
        if not self.copies:
            _check_form(self.physics, own.physics, size)
            _check_form(self.faults, own.faults, size)
            # Pictures are ignored if the environment does not observe any.
            used = {name: value for name, value in self.frames.items() if name in own.frames}
            _check_form(used, own.frames, size)
            for row, states in enumerate(self.streams):
                _check_streams(row, states, len(own.streams[0]))
        running = self.step_count[~self.begins]
        if (running >= step_limit).any():
            raise ValueError(
                f"the snapshot is of step {running.max()} of an episode, and episodes end after "
                f"{math.ceil(step_limit)} steps here: restore it where the time limit is longer"
            )

    def check(self, origin: dict[str, object], size: int) -> None:
        """Raises ValueError if the task, model, version or number of environments differs."""
        for name, kind in _KINDS.items():
            value = getattr(self, name, None)
            if not isinstance(value, kind):  # an attribute may be missing in an old pickle
                raise ValueError(
                    f"the snapshot's {name} is {value!r}; expected a {kind.__name__}, as in a "
                    "snapshot of this environment; nothing was restored"
                )
        held, wanted = self.origin.get("environment"), origin.get("environment")
        if (held is None) is not (wanted is None):
            plain = "states of plain environments"
            raise ValueError(
                f"the snapshot holds {_copies_of(held) if held else plain}; expected "
                f"{_copies_of(wanted) if wanted else plain}, as in a snapshot of this environment; "
                "nothing was restored"
            )
        for what, expected in origin.items():
            found = self.origin.get(what)
            if what == _NUMBERS and isinstance(found, dict) and isinstance(expected, dict):
                names = found.keys() | expected.keys()
                changed = sorted(n for n in names if found.get(n) != expected.get(n))
                if changed:
                    raise ValueError(
                        f"the snapshot is of a model with other values of {', '.join(changed)}; "
                        "restore it into an environment with the same model, or list fields that "
                        "starts set in the task's EPISODE_FIELDS"
                    )
            elif found != expected and not _is_patch_of(what, found, expected):
                raise ValueError(
                    f"the snapshot is of {what} {found!r}; expected {expected!r}, that of this "
                    "environment"
                )
        if len(self) != size:
            raise ValueError(
                f"the snapshot holds {len(self)} environments; expected {size}: restore it into "
                "the same number of rows"
            )

    def _check_counters(self) -> None:
        counters = {"step_count": self.step_count, "begins": self.begins}
        form = {"step_count": np.zeros(1, int), "begins": np.zeros(1, bool)}
        _check_form(counters, form, len(self))
        if (self.step_count < 0).any():
            raise ValueError(
                f"'step_count' of the snapshot is {self.step_count}; expected numbers of at least "
                "0; nothing was restored"
            )
        if self.limits is not None:
            _check_form({"limits": self.limits}, {"limits": np.zeros((1, 2))}, len(self))


def _class_of(env: object) -> str:
    return f"{type(env).__module__}.{type(env).__qualname__}"


def as_snapshot(given: object) -> Snapshot:
    """The snapshot that is to be restored; raises TypeError for anything else."""
    if not isinstance(given, Snapshot):
        raise TypeError(f"snapshot is {given!r}; expected a Snapshot, as snapshot() returns it")
    return given


def origin_of(
    task: Task,
    physics: SimulatedPhysics,
    fields: Sequence[str],
    pixels: Mapping[str, object],
    world: World | None,
) -> dict[str, object]:
    """Facts that must match for a snapshot to be restored.

    Args:
      task: the task.
      physics: a single simulation or a batch.
      fields: model fields that the snapshot itself holds.
      pixels: options of the pixel observations.
      world: settings of the world; None for the task's own.
    """
    return {
        "task": type(task).__name__,
        "fields": tuple(fields),
        "world": world,
        **pixels,
        **physics.identity(fields),
    }


def _is_patch_of(what: str, found: object, expected: object) -> bool:
    """Whether a fact is a patch version of the expected MuJoCo version, with equal numbers."""
    return what == _VERSION and str(found).startswith(f"{expected}.")


def _check_form(found: Mapping[str, object], expected: Mapping[str, np.ndarray], size: int) -> None:
    """Raises ValueError unless names, dtypes and shapes match `expected`, with `size` rows."""
    if found.keys() != expected.keys():
        raise ValueError(
            f"the snapshot holds {sorted(found)}; expected {sorted(expected)}, as in a snapshot of "
            "this environment; nothing was restored"
        )
    for name, array in expected.items():
        value, shape = found[name], (size, *array.shape[1:])
        form = (value.shape, value.dtype) if isinstance(value, np.ndarray) else type(value)
        if form != (shape, array.dtype):
            raise ValueError(
                f"{name!r} of the snapshot is {form}; expected an array of shape {shape} and "
                f"dtype {array.dtype}; nothing was restored"
            )


def _copies_of(name: object) -> str:
    return f"copies of environments ({name})"


def _check_streams(row: int, streams: object, count: int) -> None:
    if not isinstance(streams, tuple) or len(streams) != count:
        raise ValueError(
            f"the snapshot holds {streams!r} as random streams of environment {row}; expected "
            f"{count} states of a RandomState; nothing was restored"
        )
    for state in streams:
        stream = np.random.RandomState(0)
        try:
            stream.set_state(state)
            _, _, position, *_ = stream.get_state(legacy=True)
            if not 0 <= int(position) <= _KEY_LENGTH:  # NumPy would read beyond the key
                raise ValueError(f"its position is {position}; expected 0 to {_KEY_LENGTH}")
        except (TypeError, ValueError, LookupError) as error:
            raise ValueError(
                f"the snapshot holds no valid RandomState for environment {row}: {error}; "
                "nothing was restored"
            ) from error
