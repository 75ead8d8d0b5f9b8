"""The faults of the real world: delay, noise, lost and repeated values, dummies, perturbations.

    env = suite.load("walker", "walk", faults="easy")
    env = suite.load("walker", "walk", faults={"delay": {"observations": 3}})

`settings` has the faults and the presets, `memory` applies them to the rows of an environment or a
batch, and `perturbing` changes the model.
"""

from limberjack.worlds.faults.memory import FaultMemory as FaultMemory
from limberjack.worlds.faults.perturbing import Parameter as Parameter
from limberjack.worlds.faults.perturbing import Perturber as Perturber
from limberjack.worlds.faults.perturbing import Range as Range
from limberjack.worlds.faults.perturbing import Recompiles as Recompiles
from limberjack.worlds.faults.settings import CHALLENGES as CHALLENGES
from limberjack.worlds.faults.settings import Faults as Faults

__all__ = ["CHALLENGES", "FaultMemory", "Faults", "Parameter", "Perturber", "Range", "Recompiles"]
