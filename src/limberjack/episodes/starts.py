"""The kind of start that a seed gives; scores are reported for each kind.

    starts = Starts.of(factory)
    starts.kind(3)          # 'level_1'; None if the task has no kinds

Tasks name their kinds of starts: see `start` and `STARTS` of `limberjack.suite.base.Task`.
"""

from limberjack.rl.builds import Build
from limberjack.rl.copies import control_of
from limberjack.suite.base import kind_of_start
from limberjack.workers.factories import Factory

__all__ = ["Starts"]


class Starts:
    """Determines kinds of starts; the environment that it needs is made on first use."""

    def __init__(self, build: Build | None) -> None:
        """Takes what makes environments with the task's own time limit; None without kinds.

        The kind of a start may depend on more seconds than the episodes have.
        """
        self._build = build
        self._seeded = None
        self._known: dict[int, str | None] = {}

    @classmethod
    def of(cls, factory: Factory) -> "Starts":
        """The kinds of starts of a factory's environments."""
        full_length = factory.lasting()
        environment = full_length.make(0)
        task = getattr(control_of(environment), "task", None)
        has_kinds = getattr(task, "STARTS", ())
        return cls(full_length.build(environment) if has_kinds else None)

    def kind(self, seed: int) -> str | None:
        """The kind of start of the first episode of a seed; None if the task has no kinds."""
        if self._build is None:
            return None
        if seed not in self._known:
            if self._seeded is None:
                self._seeded = self._build.seeded(seed)
            self._seeded.begin(seed)
            self._seeded.environment.reset()
            self._known[seed] = kind_of_start(self._seeded.environment)
        return self._known[seed]

    def close(self) -> None:
        """Frees the environment."""
        if self._seeded is not None:
            self._seeded.environment.close()
