"""`Rows`: the fields of a simulation on a device that starts are written to, and read as one array.

    rows = Rows(simulation, starts.parts)
    rows.write(mask, values)            # values (num_envs, width), where the mask is set
    everything = rows.read()            # (num_envs, width)

Nothing waits for the device: rows are chosen by masks.
"""

from collections.abc import Sequence

from limberjack.gpu.backend import torch
from limberjack.gpu.starts import Part
from limberjack.gpu.warp_simulation import WarpSimulation

__all__ = ["Rows"]


class Rows:
    """See the module's docstring."""

    def __init__(self, simulation: WarpSimulation, parts: Sequence[Part]) -> None:
        """Takes the fields of a simulation that the parts of a start name."""
        self._targets = [(part, _target(simulation, part)) for part in parts]

    def write(self, mask: torch.Tensor, values: torch.Tensor) -> None:
        """Writes rows of numbers, (num_envs, width), into the rows of a mask, (num_envs,)."""
        for part, target in self._targets:
            _put(target, mask, values[:, part.columns])

    def write_state(self, mask: torch.Tensor, row: torch.Tensor) -> None:
        """Writes one row of numbers, (width,), into rows of a mask; the model's fields stay."""
        for part, target in self._targets:
            if part.kind in ("state", "late"):
                _put(target, mask, row[part.columns].expand(len(mask), -1))

    def read(self) -> torch.Tensor:
        """The rows as numbers, (num_envs, width) float32."""
        parts = [target.reshape(len(target), -1) for _, target in self._targets]
        return torch.cat([part.to(torch.float32) for part in parts], dim=1)


def _target(simulation: WarpSimulation, part: Part) -> torch.Tensor:
    if part.kind == "model":
        return simulation.own[part.name]
    return simulation.late.get(part.name, simulation.live(part.name))


def _put(target: torch.Tensor, mask: torch.Tensor, values: torch.Tensor) -> None:
    shaped = values.reshape(target.shape)
    given = shaped != 0 if target.dtype == torch.bool else shaped.to(target.dtype)
    torch.where(mask.reshape(-1, *(1,) * (target.ndim - 1)), given, target, out=target)
