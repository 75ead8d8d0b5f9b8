"""`Ring`: starts of episodes on a device, which are used in turn and replaced in turn.

    ring = Ring(starts)                 # (size, width), tensor
    rows = ring.take(mask)              # (num_envs, width): a start for each row of the mask
    ring.replace(new)                   # (n, width) NumPy, in place of the oldest

Which start a row takes is computed on the device: nothing waits for it.
"""

import numpy as np

from limberjack.gpu.backend import torch

__all__ = ["Ring"]


class Ring:
    """See the module's docstring.

    Attributes:
      values: the starts, (size, width).
      head: number of the start that is used next, a tensor.
      tail: number of the start that is replaced next.
    """

    def __init__(self, values: torch.Tensor) -> None:
        """Takes over the starts; the first one is used and replaced first."""
        self.values = values
        self.head = torch.zeros((), dtype=torch.int64, device=values.device)
        self.tail = 0

    def take(self, mask: torch.Tensor) -> torch.Tensor:
        """A start for each row, (num_envs, width); rows of the mask get the next ones in order."""
        count = torch.cumsum(mask, 0)
        which = torch.remainder(self.head + count - 1, len(self.values))
        self.head.copy_(torch.remainder(self.head + count[-1], len(self.values)))
        return self.values[which]

    def replace(self, rows: np.ndarray) -> None:
        """Writes new starts, (n, width), over those that were written first."""
        size = len(self.values)
        for row in np.array_split(rows, range(size - self.tail, len(rows), size)):
            fresh = torch.from_numpy(np.ascontiguousarray(row))
            if self.values.is_cuda:
                fresh = fresh.pin_memory()  # else the copy would wait for the device
            place = self.values[self.tail : self.tail + len(row)]
            place.copy_(fresh, non_blocking=True)
            self.tail = (self.tail + len(row)) % size
