"""`Gait`: the recent targets of a body with two sides, and their continuation.

    gait = Gait(names)  # of the actuators
    gait.add(targets)  # at each control step
    gait.repeated(times, step=14)  # each step repeats the other side's step before

It knows nothing of costs or planning.
"""

import numpy as np

__all__ = ["Gait"]


class Gait:
    """Targets that a humanoid followed in the last control steps."""

    def __init__(self, names: list[str]) -> None:
        """Takes the actuators' names; a side's begin with `left_` or `right_`."""
        opposite = {"left": "right", "right": "left"}
        parts = [name.partition("_") for name in names]
        mirrored = [opposite.get(side, side) + rest + joint for side, rest, joint in parts]
        self._sources = [names.index(name) for name in mirrored]
        # Angles of these joints change their sign when left and right are exchanged.
        aside = ("abdomen_z", "abdomen_x", "ankle_x", "shoulder1", "shoulder2")
        self._signs = np.array([-1.0 if name.endswith(aside) else 1.0 for name in names])
        self._targets: list[np.ndarray] = []

    def __len__(self) -> int:
        """Number of control steps that are stored."""
        return len(self._targets)

    def add(self, targets: np.ndarray) -> None:
        """Stores the targets of a control step, (nu,)."""
        self._targets.append(targets)
        del self._targets[:-60]  # more than two steps

    def mirrored(self, targets: np.ndarray) -> np.ndarray:
        """The same with left and right exchanged, (..., nu)."""
        return self._signs * targets[..., self._sources]

    def middle(self, step: int) -> np.ndarray:
        """The mean of the targets over the last two steps, the same for both sides, (nu,)."""
        mean = np.mean(self._targets[-2 * step :], axis=0)
        return (mean + self.mirrored(mean)) / 2

    def repeated(self, times: np.ndarray, step: int) -> np.ndarray:
        """The targets at times from now on if the gait continues, (n, nu).

        Args:
          times: in control steps; the stored targets are those at -1, -2 and so on.
          step: control steps after which the other side repeats the motion.
        """
        back = np.ceil((times + 1.0) / step).clip(0.0)
        done = np.array(self._targets)
        places = (len(done) + times - back * step).clip(0.0, len(done) - 1.0)
        left = np.minimum(places.astype(int), len(done) - 2)
        part = (places - left)[:, None]
        then = (1.0 - part) * done[left] + part * done[left + 1]
        return np.where(back[:, None] % 2 == 1, self.mirrored(then), then)
