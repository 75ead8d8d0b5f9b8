"""`Sizes`: room for contacts and constraints on a device, from a model's own peak on the CPU.

    sizes = measured(environment)       # Sizes(nconmax=40, njmax=144)

Arrays on a device have fixed sizes. Contacts and constraints for which there is no room are lost;
`Outcome.overflow` marks the rows.
"""

import dataclasses

import numpy as np

from limberjack.rl.action_specs import bounded_spec, bounds_to_try
from limberjack.rl.control import Environment, PhysicsError

__all__ = ["Sizes", "measured"]

_EPISODES = 6  # half of them with random actions, half with one extreme action throughout
_STEPS = 60  # control steps of each: falling down takes the humanoid 40
_SEED = 0
_HEADROOM = 2.0  # of the peak: episodes of a trained policy meet more than random actions do
_FEW_CONTACTS, _FEW_ROWS = 16, 40  # added to the headroom, for models with few contacts
_UNIT = 8  # sizes are multiples of it


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Room on a device.

    Attributes:
      nconmax: contacts for each row, on average over all rows.
      njmax: rows of constraints for each row, at most.
    """

    nconmax: int
    njmax: int


def measured(environment: Environment) -> Sizes:
    """Room for twice the most contacts and constraints of some episodes, and a little more.

    Args:
      environment: stepped from new episodes; its random stream is advanced.
    """
    contacts = rows = 0
    random = np.random.RandomState(_SEED)
    spec = bounded_spec(environment.task, environment.physics)
    low, high = bounds_to_try(spec)
    for episode in range(_EPISODES):
        environment.reset()
        action = np.where(random.uniform(size=spec.shape) < 0.5, low, high)
        for _ in range(_STEPS):
            if episode % 2:
                action = random.uniform(low, high)
            try:
                environment.step(action)
            except PhysicsError:
                break
            data = environment.physics.data._data
            contacts, rows = max(contacts, data.ncon), max(rows, data.nefc)
    return Sizes(
        _rounded(_HEADROOM * contacts + _FEW_CONTACTS), _rounded(_HEADROOM * rows + _FEW_ROWS)
    )


def _rounded(size: float) -> int:
    return int(np.ceil(size / _UNIT)) * _UNIT
