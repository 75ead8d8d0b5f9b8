"""The speed of a task on this machine: of the physics alone, a batch, a Gymnasium environment.

    result = bench.measure("humanoid", "walk", num_envs=256, columns=("step", "inference"))
    result = bench.measure(my_package.make)         # make(seed) -> Environment
    for speed in result.speeds:
        print(speed.what, speed.num_threads, speed.steps_per_second)
    for row in result.rows:
        print(row.num_threads, row.cells["step"].steps_per_second)
    print(result.recommended_threads["step"])

Whatever is compared takes turns: a block of steps each within the same fraction of a second, so
that other load on the machine slows all alike. A step is one action of one environment, whatever
number of physics steps it has; an environment may repeat actions. Starts of episodes are not
measured: they take at most 2 % of an episode. If a task ends some episodes early, the starts after
those count towards the batch and the vector environment.
"""

from limberjack.bench.columns import COLUMNS, NEARLY_BEST, OURS, Cell, Result, Row, Speed, measure
from limberjack.bench.contest import Contest, Player, player, take_turns

__all__ = [
    "COLUMNS",
    "NEARLY_BEST",
    "OURS",
    "Cell",
    "Contest",
    "Player",
    "Result",
    "Row",
    "Speed",
    "measure",
    "player",
    "take_turns",
]
