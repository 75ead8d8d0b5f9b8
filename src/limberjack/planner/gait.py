"""`Gait`: what a body with two sides did lately, and what it does next if it goes on so.

    gait = Gait(names)  # of the actuators
    gait.do(targets)  # at each control step
    gait.repeated(times, step=14)  # what the other side did a step before, and so on

It knows nothing of costs or planning.
"""

import numpy as np

__all__ = ["Gait"]

_KEPT = 60  # control steps
_OTHER = {"left": "right", "right": "left"}

# Joints whose angles change their sign when left and right are exchanged.
_ASIDE = ("abdomen_z", "abdomen_x", "ankle_x", "shoulder1", "shoulder2")


class Gait:
    """What a humanoid did in the last control steps."""

    def __init__(self, names: list[str]) -> None:
        """Takes the actuators' names; a side's begin with `left_` or `right_`."""
        self._sources = []
        for name in names:
            side, _, joint = name.partition("_")
            self._sources.append(names.index(f"{_OTHER[side]}_{joint}" if side in _OTHER else name))
        self._signs = np.array([-1.0 if name.endswith(_ASIDE) else 1.0 for name in names])
        self._targets: list[np.ndarray] = []

    def __len__(self) -> int:
        """How many control steps it remembers."""
        return len(self._targets)

    def do(self, targets: np.ndarray) -> None:
        """Remembers what is followed for a control step, (nu,)."""
        self._targets.append(targets)
        del self._targets[:-_KEPT]

    def mirrored(self, targets: np.ndarray) -> np.ndarray:
        """The same with left and right exchanged, (..., nu)."""
        return self._signs * targets[..., self._sources]

    def middle(self, step: int) -> np.ndarray:
        """The mean of the targets over the last two steps, the same for both sides, (nu,)."""
        mean = np.mean(self._targets[-2 * step :], axis=0)
        return (mean + self.mirrored(mean)) / 2

    def repeated(self, times: np.ndarray, step: int) -> np.ndarray:
        """The targets at times from now on if it goes on so, (n, nu).

        Args:
          times: in control steps; what is remembered was done from -1, -2 and so on.
          step: control steps in which the other side does the same.
        """
        back = np.ceil((times + 1.0) / step).clip(0.0)
        done = np.array(self._targets)
        places = (len(done) + times - back * step).clip(0.0, len(done) - 1.0)
        left = np.minimum(places.astype(int), len(done) - 2)
        part = (places - left)[:, None]
        then = (1.0 - part) * done[left] + part * done[left + 1]
        return np.where(back[:, None] % 2 == 1, self.mirrored(then), then)
