"""Record the bits that `limberjack doctor --exact` compares with, on this machine.

    python tools/record_bits.py

A run takes the place of one of the same kind of processor, NumPy and MuJoCo in
src/limberjack/doctor/stored_bits.json; others stay. To record another version of NumPy, install it
beside Limberjack in an environment of its own and run this there.
"""

from pathlib import Path

import numpy as np

from limberjack import suite
from limberjack.doctor.exactness import played
from limberjack.doctor.stored_bits import FILE, Kind, Run, StoredBits, field_of

__all__ = ["record"]


def record(path: Path = FILE, tasks: tuple[tuple[str, str], ...] = suite.ALL_TASKS) -> Run:
    """Plays the tasks in this process and stores what the single environments return.

    Raises:
      RuntimeError: a batch differs from single environments.
    """
    fields = {}
    for task in tasks:
        found = played(*task)
        for name, values in found.single.items():
            if not np.array_equal(values.view(np.int64), found.batch[name].view(np.int64)):
                raise RuntimeError(f"{':'.join(task)}: {name} of the batch differs; nothing stored")
        fields[":".join(task)] = {name: field_of(one) for name, one in found.single.items()}
    run = Run(Kind.here(), fields)
    stored = StoredBits.read(path) if path.exists() else StoredBits()
    stored.with_run(run).write(path)
    return run


if __name__ == "__main__":
    print(record().kind)
