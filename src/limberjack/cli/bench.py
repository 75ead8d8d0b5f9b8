"""`limberjack bench`: the speed of a task on this machine."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import rich.table
import typer

from limberjack.cli.app import command
from limberjack.cli.options import Domain, TaskName, named_task, refuse_beside
from limberjack.cli.output import MISUSED, complain, console, misuse_reported, table
from limberjack.cli.progress import show_parts
from limberjack.utils.facts import title_of

if TYPE_CHECKING:
    from limberjack.bench import Result

__all__: list[str] = []

_COLUMNS = "step,inference"  # by default
_LABELS = {
    "physics": "MuJoCo alone (mujoco.batch)",
    "batch": "BatchEnvironment",
    "vector": "Gymnasium VectorEnv (flat, float32)",
}


@command(
    "bench",
    "limberjack bench humanoid walk",
    "limberjack bench stacker/stack_2 --num-envs 1024 --threads 1,2,4,8",
    "limberjack bench walker walk --num-envs 16 --columns step,inference,training",
    "limberjack bench humanoid walk --num-envs 4096 --device cuda:0",
)
def _bench(
    domain: Domain,
    task: TaskName = None,
    num_envs: Annotated[
        int, typer.Option(metavar="N", min=1, help="Environments in the batch.")
    ] = 256,
    threads: Annotated[
        str | None,
        typer.Option(
            metavar="N,N", help="Numbers of threads to try; by default 1, 2, 4 ... usable cores."
        ),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What to measure, of step, inference (with a policy's forward pass), and "
            "training (with the learner of `limberjack train`).",
            show_default=_COLUMNS,
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(metavar="X", help="Approximate time for each comparison.")
    ] = 3.0,
    device: Annotated[
        str | None, typer.Option(help="Measure MuJoCo Warp on it instead, such as cuda:0.")
    ] = None,
) -> None:
    """Measure how fast a batch of a task steps on this machine, and with how many threads.

    The first table gives the same random actions, in turns, to MuJoCo alone, to a BatchEnvironment
    and to a Gymnasium VectorEnv, so it shows what the environments add to the simulation. The
    second one has steps per second of the VectorEnv by number of threads, alone, with a policy and
    with learning, beside EnvPool where it is installed. One action is one step in all of them.
    """
    if device is not None:
        with misuse_reported():
            where = named_task(domain, task)
            refuse_beside(
                {"--threads": threads, "--columns": columns},
                f"--device {device}, which measures MuJoCo Warp: leave it out, or leave out "
                "--device to measure batches on this machine's cores",
            )
        _bench_on_device(*where, num_envs, device, seconds)
        return
    with misuse_reported(), show_parts() as show:
        from limberjack import bench

        result = bench.measure(
            *named_task(domain, task),
            num_envs,
            _numbers(threads),
            seconds,
            [name.strip() for name in (_COLUMNS if columns is None else columns).split(",")],
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
    typer.echo(
        f"{title_of(result.facts)}: {num_envs} environments, random actions. "
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
    console().print(rows)
    for column, why in result.missing.items():
        complain(f"{column} is not measured: {why}")
    if result.recommended_threads:
        typer.echo("\nSteps/s by number of threads:\n")
        console().print(_by_threads(result))
        typer.echo(f"\n{_advice(result.recommended_threads, num_envs)}")


def _numbers(threads: str | None) -> list[int] | None:
    """The numbers of --threads; raises ValueError if one is none."""
    if threads is None:
        return None
    try:
        return [int(number) for number in threads.split(",")]
    except ValueError:
        raise ValueError(f"--threads is {threads!r}; expected numbers, such as 1,2,4") from None


def _by_threads(result: "Result") -> rich.table.Table:
    columns = list(result.recommended_threads)
    rows = table("", "threads>", *(f"{name}>" for name in columns), "p95 of a step>", "memory>")
    for row in result.rows:
        speeds = [
            f"{row.cells[name].steps_per_second:,.0f}" if name in row.cells else ""
            for name in columns
        ]
        first = row.cells[columns[0]]
        memory = "" if row.megabytes is None else f"{row.megabytes:,.0f} MB"
        rows.add_row(
            row.what, str(row.num_threads), *speeds, f"{1e3 * first.seconds_95:.1f} ms", memory
        )
    return rows


def _advice(threads: Mapping[str, int], num_envs: int) -> str:
    """The recommended numbers of threads, as a sentence."""
    from limberjack import bench

    numbers = set(threads.values())
    each = ", ".join(f"{count} ({column})" for column, count in threads.items())
    return (
        f"Recommended: num_threads={numbers.pop() if len(numbers) == 1 else each} for {num_envs} "
        f"environments, the fewest that reach {bench.NEARLY_BEST:.0%} of the highest speed"
    )
