"""`limberjack bench`: how fast a task steps here."""

from typing import Annotated

import typer

from limberjack.cli.app import app
from limberjack.cli.options import Domain, TaskName
from limberjack.cli.output import console, misuse_reported, table

__all__: list[str] = []


@app.command("bench")
def _bench(
    domain: Domain,
    task: TaskName,
    num_envs: Annotated[int, typer.Option(min=1, help="Rows of the batch.")] = 256,
    threads: Annotated[
        int | None, typer.Option(min=1, help="The most to try; by default the usable cores.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="For each of the two comparisons, about.")] = 3.0,
) -> None:
    """Measure how fast a batch of a task steps on this machine, and with how many threads.

    What is compared does the same random actions in turns: MuJoCo alone (`physics`), a
    BatchEnvironment (`batch`) and a Gymnasium VectorEnv, flat and float32 (`vector`).
    """
    with misuse_reported():
        from limberjack import bench

        result = bench.measure(domain, task, num_envs, threads, seconds)
    rows = table("what", "threads>", "steps/s>", "of physics>", "of 1 thread>")
    for speed in result.speeds:
        rate = f"{speed.steps_per_second:,.0f}"
        rows.add_row(speed.what, str(speed.num_threads), rate, f"{speed.ratio:.2f}", "")
    rows.add_section()
    for speed in result.sweep:
        rate = f"{speed.steps_per_second:,.0f}"
        rows.add_row(speed.what, str(speed.num_threads), rate, "", f"{speed.ratio:.2f}")
    console().print(rows)
    best = result.recommended_threads
    typer.echo(f"Recommended for {num_envs} rows: num_threads={best}")
