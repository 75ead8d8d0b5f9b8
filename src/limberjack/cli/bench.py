"""`limberjack bench`: the speed of a task on this machine."""

from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import Domain, TaskName, named_task
from limberjack.cli.output import MISUSED, complain, console, misuse_reported, table
from limberjack.cli.progress import show_parts

if TYPE_CHECKING:
    from limberjack.bench import Result

__all__: list[str] = []

_LABELS = {
    "physics": "MuJoCo alone (mujoco.batch)",
    "batch": "BatchEnvironment",
    "vector": "Gymnasium VectorEnv (flat, float32)",
}


@command(
    "bench",
    "limberjack bench humanoid walk",
    "limberjack bench stacker/stack_2 --num-envs 1024",
    "limberjack bench humanoid walk --num-envs 4096 --device cuda:0",
)
def _bench(
    domain: Domain,
    task: TaskName = None,
    num_envs: Annotated[
        int, typer.Option(metavar="N", min=1, help="Environments in the batch.")
    ] = 256,
    threads: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="The most to try; by default the usable cores."),
    ] = None,
    seconds: Annotated[
        float, typer.Option(metavar="X", help="Approximate time for each of the two comparisons.")
    ] = 3.0,
    device: Annotated[
        str | None, typer.Option(help="Measure MuJoCo Warp on it instead, such as cuda:0.")
    ] = None,
) -> None:
    """Measure how fast a batch of a task steps on this machine, and with how many threads.

    The first comparison gives the same random actions, in turns, to MuJoCo alone, to a
    BatchEnvironment and to a Gymnasium VectorEnv, so it shows what the environments add to the
    simulation. The second one steps the VectorEnv with 1, 2, 4 ... threads.
    """
    if device is not None:
        _bench_on_device(*named_task(domain, task), num_envs, device, seconds)
        return
    with misuse_reported(), show_parts() as show:
        from limberjack import bench

        result = bench.measure(
            *named_task(domain, task),
            num_envs,
            threads,
            seconds,
            on_progress=lambda part, share: show(part, share, 1.0),
        )
    _print(result, num_envs)


def _bench_on_device(
    domain: str, task: str | None, num_envs: int, device: str, seconds: float
) -> None:
    try:
        from limberjack.gpu import speed
    except ImportError as error:
        complain(error)
        raise typer.Exit(MISUSED) from None
    with misuse_reported(), show_parts() as show:
        result = speed.measure(
            *(domain, task or "", num_envs, device, seconds),
            on_progress=lambda part, share: show(part, share, 1.0),
        )
    typer.echo(
        f"{result.task} on {result.device}: {num_envs} environments, random actions. A step is one "
        "action of one environment; steps/s counts all environments.\n"
    )
    rows = table("stepped", "steps/s>", "speed>")
    rows.add_row("MuJoCo Warp alone", f"{result.bare_steps_per_second:,.0f}", "1.00 x")
    rows.add_row("VectorEnv", f"{result.steps_per_second:,.0f}", f"{result.ratio:.2f} x")
    console().print(rows)
    typer.echo(f"\nMemory: {result.bytes_per_row / 1e3:.0f} kB for each environment")
    typer.echo(f"Contacts or constraints without room: {result.overflows} steps of environments")


def _print(result: "Result", num_envs: int) -> None:
    from limberjack import bench

    typer.echo(
        f"{' '.join(map(str, result.facts.values()))}: {num_envs} environments, random actions. "
        "A step is one action of one environment; steps/s counts all environments.\n"
    )
    rows = table("stepped", "threads>", "steps/s>", "speed>", "relative to")
    for speed in result.speeds:
        rows.add_row(
            _LABELS[speed.what],
            str(speed.num_threads),
            f"{speed.steps_per_second:,.0f}",
            f"{speed.ratio:.2f} x",
            "MuJoCo alone, same steps",
        )
    rows.add_section()
    for speed in result.sweep:
        rows.add_row(
            _LABELS[speed.what],
            str(speed.num_threads),
            f"{speed.steps_per_second:,.0f}",
            f"{speed.ratio:.2f} x",
            f"the same with {result.sweep[0].num_threads} thread",
        )
    console().print(rows)
    typer.echo(
        "\nSpeeds are medians over many turns, so they may differ slightly from ratios of steps/s."
    )
    typer.echo(
        f"Recommended: num_threads={result.recommended_threads} for {num_envs} environments, the "
        f"fewest that reach {bench.NEARLY_BEST:.0%} of the highest speed"
    )
