"""Record the bits that `limberjack doctor --exact` compares with, on this machine.

    python tools/record_bits.py          # with NumPy's widest vectors, and with AVX2
    python tools/record_bits.py --one    # in this process only

A run takes the place of one of the same kind of processor, NumPy and MuJoCo in
src/limberjack/doctor/stored_bits.json; others stay. To record another version of NumPy, install it
beside Limberjack in an environment of its own and run this there. NumPy's AVX2 is recorded by
switching wider vectors off (NPY_DISABLE_CPU_FEATURES), so a processor without them may differ in
functions of the C library.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from limberjack import suite
from limberjack.doctor.exactness import played
from limberjack.doctor.stored_bits import FILE, Kind, Run, StoredBits, field_of

__all__ = ["main", "record"]

_DISABLE = "NPY_DISABLE_CPU_FEATURES"
_WIDE = "AVX512", "X86_V4"  # how the names of NumPy's features wider than AVX2 begin


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


def main(
    one: Annotated[bool, typer.Option("--one", help="Record in this process only.")] = False,
) -> None:
    """Record the bits of this machine's kinds."""
    if one:
        typer.echo(record().kind)
        return
    features = np.show_config(mode="dicts")
    found = features["SIMD Extensions"].get("found", []) if features else []
    wide = [name for name in found if name.startswith(_WIDE)]
    for disabled in [[], wide] if wide else [[]]:
        environment = {**os.environ, _DISABLE: " ".join(disabled)}
        subprocess.run([sys.executable, __file__, "--one"], env=environment, check=True)


if __name__ == "__main__":
    typer.run(main)
