"""Work on many processes and machines: the same bits as in one process, in any order.

    setup = prepare("manipulator", "bring_ball", "planner")
    units = [Unit(setup, seeds) for seeds in units_of(range(100), setup.unit_size)]
    with open_workers(workers=4) as workers:
        for unit, result in workers.results(function, units):     # function(setup, seeds)
            ...

An episode depends on its setup (task, versions, policy) and its seed alone, so any worker can play
any unit, even twice. The process that reads the results writes files, except those of episodes,
which workers write. Each worker first proves that it has the same identity and that a few steps
give the same bits.
"""

from limberjack.workers.attempt import WorkError
from limberjack.workers.scale import Scale, Workers, open_workers
from limberjack.workers.setup import Opened, Setup, prepare
from limberjack.workers.state import OnProgress, OnState, State, counted_from
from limberjack.workers.units import Unit, shard_of, units_of

__all__ = [
    "OnProgress",
    "OnState",
    "Opened",
    "Scale",
    "Setup",
    "State",
    "Unit",
    "WorkError",
    "Workers",
    "counted_from",
    "open_workers",
    "prepare",
    "shard_of",
    "units_of",
]
