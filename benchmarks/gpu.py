"""The suite on a GPU: steps per second relative to MuJoCo Warp alone, and memory per environment.

    python benchmarks/gpu.py [--seconds 480] [--device cuda:0] [--json FILE]

It measures one task of each domain at three sizes, the domains in turn, until the time is over, at
least one. Each result is written to the file as soon as it is there; results that the file already
has are skipped, so the same command continues a run that was cut off.

Without a GPU it says so and runs its checks on the processor, with few environments: the figures
then say nothing about a GPU, and no bar is applied. The exit status is 1 if a bar is missed.
"""

import dataclasses
import json
import platform
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import sources
import typer

from limberjack import gpu, suite

__all__ = ["main", "measured"]

_SIZES = (4096, 1024, 16384)  # the size with the bar first
_SIZES_WITHOUT_GPU = (8,)
_BAR_SIZE, _BAR = 4096, 0.85  # of MuJoCo Warp's bare steps
_SECONDS_EACH = 5.0  # of measuring, besides compilation


def measured(device: str, seconds: float, file: Path | None, sizes: tuple[int, ...]) -> list[Any]:
    """Measures tasks until the time is over, and writes each result as it comes.

    Args:
      device: such as 'cuda:0'.
      seconds: in which to begin measurements.
      file: JSON of earlier results, which is continued; None writes none.
      sizes: numbers of environments, the most important first.
    """
    from limberjack.gpu import speed

    end = time.monotonic() + seconds
    kept = json.loads(file.read_text(encoding="utf-8")) if file and file.exists() else {}
    results: list[dict[str, Any]] = kept.get("results", [])
    machine = {"processor": platform.processor() or platform.machine(), "system": platform.system()}
    done = {(each["task"], each["num_envs"]) for each in results}
    count = len(results)
    each_seconds = _SECONDS_EACH if device != "cpu" else 0.1
    for domain, task, num_envs in _wanted(sizes):
        if time.monotonic() > end and len(results) > count:
            break
        if (f"{domain}:{task}", num_envs) in done:
            continue
        try:
            found = dataclasses.asdict(speed.measure(domain, task, num_envs, device, each_seconds))
        except MemoryError as error:
            typer.echo(f"{domain}:{task}, {num_envs}: {error}")
            continue
        results.append(found)
        typer.echo(
            f"{domain}:{task}, {num_envs}: {found['steps_per_second']:,.0f} steps/s, "
            f"{found['ratio']:.2f} of MuJoCo Warp alone, {found['bytes_per_row'] / 1e3:.0f} kB each"
        )
        if file:
            sources.write(file, {"machine": machine, "results": results})
    return results


def main(
    seconds: Annotated[float, typer.Option(help="In which to begin measurements.")] = 480.0,
    device: Annotated[str, typer.Option(help="Such as cuda:0.")] = "cuda:0",
    file: Annotated[
        Path | None, typer.Option("--json", help="Results, written as they come.")
    ] = None,
) -> None:
    """Measures the speed of the suite on a GPU."""
    from limberjack.gpu.backend import device_of

    sizes = _SIZES
    try:
        device_of(device)
    except ValueError as error:
        typer.echo(f"No GPU: {error}.\nThese are checks on the processor, not measurements.")
        device = "cpu"
    if device == "cpu":
        sizes = _SIZES_WITHOUT_GPU
    results = measured(device, seconds, file, sizes)
    overflows = [each["task"] for each in results if each["overflows"]]
    if overflows:
        typer.echo(f"contacts or constraints had no room in {', '.join(overflows)}")
    missed = [
        each["task"] for each in results if each["num_envs"] == _BAR_SIZE and each["ratio"] < _BAR
    ]
    if missed:
        typer.echo(f"below {_BAR} of MuJoCo Warp alone: {', '.join(missed)}")
    sys.exit(1 if missed or overflows else 0)


def _wanted(sizes: tuple[int, ...]) -> Iterator[tuple[str, str, int]]:
    """One task of each domain, at each size."""
    of_domain = {task[0]: task for task in suite.BENCHMARKING + suite.EXTRA}
    for size in sizes:
        for domain, task in of_domain.values():
            if (domain, task) not in gpu.REFUSED:
                yield domain, task, size


if __name__ == "__main__":
    typer.run(main)
