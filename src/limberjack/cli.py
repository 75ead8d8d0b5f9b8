"""The command `limberjack`: list the tasks, run one and watch it, measure how fast one steps.

    limberjack list
    limberjack run humanoid walk --policy random --episodes 3 --out demo
    limberjack bench humanoid walk --num-envs 256

Tables go to standard output; the progress bar, notes and errors go to standard error. The exit
status is 0, 1 if a run failed, 2 for a mistake on the command line, 130 after Ctrl-C.

Everything heavy is imported by the command that needs it, so that `--help` answers at once.
"""

import contextlib
import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import rich.box
import rich.console
import rich.progress
import rich.table
import typer

import limberjack

if TYPE_CHECKING:
    from limberjack.policies import Policy
    from limberjack.report import Recorder
    from limberjack.rollout import Episode

__all__ = ["app", "main"]

_FAILED = 1
_MISUSED = 2
_INTERRUPTED = 130  # as shells report a program that Ctrl-C ended

_SEEDS = 2**32  # numpy.random.RandomState takes seeds below this
_PIPE_WIDTH = 200  # columns where there is no terminal: no row is broken
_BAR_UPDATE = 10  # steps; the bar is drawn ten times a second at most

app = typer.Typer(
    name="limberjack",
    help="Control tasks on MuJoCo: humanoid, manipulator and stacker.",
    no_args_is_help=True,
    rich_markup_mode="markdown",  # joins the lines of a paragraph
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Runs the command line and exits."""
    app(prog_name="limberjack")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(limberjack.__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    pass


@app.command("list")
def _list() -> None:
    """List the tasks, their tags, and the sizes of actions and observations."""
    from limberjack import suite

    tags = {
        "benchmarking": suite.BENCHMARKING,
        "easy": suite.EASY,
        "hard": suite.HARD,
        "extra": suite.EXTRA,
    }
    table = _table("domain", "task", "tags", "action>", "observation>")
    for domain, task in suite.ALL_TASKS:
        environment = suite.load(domain, task)
        observation = environment.observation_spec().values()
        table.add_row(
            domain,
            task,
            ", ".join(tag for tag, tasks in tags.items() if (domain, task) in tasks),
            str(math.prod(environment.action_spec().shape)),
            str(sum(math.prod(spec.shape) for spec in observation)),
        )
        environment.close()
    _console().print(table)


@app.command("run")
def _run(
    domain: Annotated[
        str, typer.Argument(metavar="DOMAIN", help="Such as humanoid; `limberjack list` has all.")
    ],
    task: Annotated[str, typer.Argument(metavar="TASK", help="Such as walk.")],
    episodes: Annotated[int, typer.Option(min=1, help="How many to run.")] = 1,
    seed: Annotated[
        int, typer.Option(min=0, max=_SEEDS - 1, help="Of the first episode; the next has seed+1.")
    ] = 0,
    policy: Annotated[
        str, typer.Option(metavar="NAME", help="What acts: zero, random or MODULE:CALLABLE.")
    ] = "zero",
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds per episode; the task's own by default.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write result.json, return.png and video.mp4 here."),
    ] = None,
) -> None:
    """Run episodes of a task and show their returns.

    Each episode is the first one of an environment with its own seed, so any of them can be run
    again alone. The video shows the first episode.

    A policy of your own is a function from an observation (a dictionary of arrays) to an action, or
    a class with act(observation) and, if it needs it, reset(). Its module may lie in the working
    directory.
    """
    with _misuse_reported():
        run = _Run(domain, task, range(seed, seed + episodes), policy, time_limit, out)
    failure = run.play()
    status = run.report(failure)
    if status is None:
        assert failure is not None
        raise failure
    raise typer.Exit(status)


@app.command("bench")
def _bench(
    domain: Annotated[str, typer.Argument(metavar="DOMAIN", help="Such as humanoid.")],
    task: Annotated[str, typer.Argument(metavar="TASK", help="Such as walk.")],
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
    with _misuse_reported():
        from limberjack import bench

        result = bench.measure(domain, task, num_envs, threads, seconds)
    table = _table("what", "threads>", "steps/s>", "of physics>", "of 1 thread>")
    for speed in result.speeds:
        rate = f"{speed.steps_per_second:,.0f}"
        table.add_row(speed.what, str(speed.num_threads), rate, f"{speed.ratio:.2f}", "")
    table.add_section()
    for speed in result.sweep:
        rate = f"{speed.steps_per_second:,.0f}"
        table.add_row(speed.what, str(speed.num_threads), rate, "", f"{speed.ratio:.2f}")
    _console().print(table)
    best = result.recommended_threads
    typer.echo(f"Recommended for {num_envs} rows: num_threads={best}")


class _Run:
    """One call of `limberjack run`."""

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: range,
        policy: str,
        time_limit: float | None,
        out: Path | None,
    ) -> None:
        """Checks everything that was asked for; raises ValueError or OSError."""
        from limberjack import report

        if seeds[-1] >= _SEEDS:
            raise ValueError(f"the last episode's seed is {seeds[-1]}; expected below {_SEEDS}")
        if time_limit is not None and math.isinf(time_limit):
            raise ValueError(f"--time-limit is {time_limit}; expected a number of seconds")
        self._where = (domain, task)
        self._seeds = seeds
        self._time_limit = time_limit
        self._policy_name = policy
        first = self._load(seeds[0])
        self._policy: Policy = _find_policy(policy)
        self._fingerprint = report.fingerprint(first.physics.model._model)
        self._control_timestep = first.control_timestep()
        self._step_limit = first.step_limit
        self._recorder: Recorder | None = None if out is None else report.Recorder(out)
        self._episodes: list[Episode] = []
        first.close()

    def play(self) -> BaseException | None:
        """Runs the episodes; returns what cut them short, if anything did."""
        try:
            with _progress(len(self._seeds)) as progress:
                for seed in self._seeds:
                    self._episodes.append(self._play_episode(seed, progress))
        except BaseException as failure:  # Ctrl-C too: finished episodes are kept
            return failure
        return None

    def report(self, failure: BaseException | None) -> int | None:
        """Writes and prints what was played; returns the exit status, None for unknown failures."""
        from limberjack.policies import PolicyError
        from limberjack.rl.control import PhysicsError

        unwritten = self._write_files()  # first: printing fails where nobody reads
        _print_episodes(self._episodes)
        self._print_files()
        if unwritten is not None:
            _complain(unwritten)
        if failure is None:
            return 0 if unwritten is None else _FAILED
        done = f"{len(self._episodes)} of {len(self._seeds)} episodes finished"
        if isinstance(failure, KeyboardInterrupt):
            _complain(f"interrupted: {done}")
            return _INTERRUPTED
        if isinstance(failure, PolicyError | PhysicsError):
            _complain(f"{failure}; {done}")
            return _FAILED
        return None

    def _load(self, seed: int) -> Any:
        from limberjack import suite

        task_kwargs: dict[str, Any] = {"random": seed}
        if self._time_limit is not None:
            task_kwargs["time_limit"] = self._time_limit
        return suite.load(*self._where, task_kwargs=task_kwargs)

    def _play_episode(self, seed: int, progress: "_Progress") -> "Episode":
        """The first episode of an environment with this seed."""
        from limberjack import rollout

        environment = self._load(seed)
        recorder = self._recorder if seed == self._seeds[0] else None
        if recorder is not None:
            recorder.begin_film(environment)
        limit = self._step_limit

        def on_step(steps: int, total: float) -> None:
            progress.show(seed - self._seeds[0], steps, limit, total)
            if recorder is not None:
                recorder.add_frame()

        with contextlib.closing(environment):
            episode = rollout.run_episode(environment, self._policy, seed, on_step)
            if recorder is not None:
                recorder.finish_film()
        return episode

    def _write_files(self) -> OSError | None:
        """Writes what was asked for; returns why it could not."""
        if self._recorder is None:
            return None
        domain, task = self._where
        time_limit = self._time_limit
        if time_limit is None and self._step_limit is not None:
            time_limit = self._step_limit * self._control_timestep
        run = {
            "domain": domain,
            "task": task,
            "policy": self._policy_name,
            "time_limit": time_limit,
            "control_timestep": self._control_timestep,
            "episodes_asked_for": len(self._seeds),
        }
        try:
            self._recorder.write(run, self._episodes, self._fingerprint)
        except OSError as error:
            return error
        return None

    def _print_files(self) -> None:
        if self._recorder is None:
            return
        for line in self._recorder.left_out:
            _complain(line)
        for path in self._recorder.written:
            typer.echo(path)


class _Progress:
    """A bar over all episodes with the running return; silent where there is no terminal."""

    def __init__(self, bar: rich.progress.Progress, episodes: int) -> None:
        self._bar = bar
        self._episodes = episodes
        self._task = bar.add_task("", total=episodes, total_return=0.0)

    def show(self, finished: int, steps: int, step_limit: int | None, total: float) -> None:
        """Shows the step of the running episode, some of the time."""
        if self._bar.disable or (steps % _BAR_UPDATE and steps != step_limit):
            return
        part = steps / step_limit if step_limit else 0.0
        self._bar.update(
            self._task,
            completed=finished + part,
            description=f"episode {finished + 1}/{self._episodes}",
            total_return=total,
        )


@contextlib.contextmanager
def _progress(episodes: int) -> Iterator[_Progress]:
    columns = (
        "{task.description}",
        rich.progress.BarColumn(),
        "return {task.fields[total_return]:.1f}",
        rich.progress.TimeRemainingColumn(),
    )
    with rich.progress.Progress(
        *columns,
        console=rich.console.Console(stderr=True),
        disable=not sys.stderr.isatty(),
        transient=True,
    ) as bar:
        yield _Progress(bar, episodes)


def _find_policy(name: str) -> "Policy":
    from limberjack import policies

    # The installed command does not look for modules in the working directory; `python -m` does.
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    return policies.find(name)


def _print_episodes(episodes: "list[Episode]") -> None:
    with_start = any(episode.start is not None for episode in episodes)
    table = _table("seed>", *(["start"] if with_start else []), "return>", "steps>")
    for episode in episodes:
        start = [str(episode.start)] if with_start else []
        table.add_row(str(episode.seed), *start, f"{episode.total:.3f}", str(episode.length))
    if len(episodes) > 1:
        totals = [episode.total for episode in episodes]
        mean = sum(totals) / len(totals)
        table.add_section()
        table.add_row("mean", *([""] if with_start else []), f"{mean:.3f}", "")
    if episodes:
        _console().print(table)


def _table(*columns: str) -> rich.table.Table:
    """An empty table; a column whose name ends in '>' is aligned to the right."""
    table = rich.table.Table(box=rich.box.SIMPLE_HEAD, show_edge=False)
    for column in columns:
        name = column.removesuffix(">")
        table.add_column(name, justify="left" if name == column else "right", no_wrap=True)
    return table


def _console() -> rich.console.Console:
    return rich.console.Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH)


@contextlib.contextmanager
def _misuse_reported() -> Iterator[None]:
    """Turns an error in what was asked for into one line and exit status 2."""
    try:
        yield
    except (ValueError, OSError) as error:
        _complain(error)
        raise typer.Exit(_MISUSED) from None


def _complain(what: object) -> None:
    """Writes one line to standard error."""
    typer.echo(f"limberjack: {' '.join(str(what).split())}", err=True)
