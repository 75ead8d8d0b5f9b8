"""`limberjack solve`: episodes of a task with the planner."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from limberjack.cli.app import app
from limberjack.cli.options import Domain, FirstSeed, TaskName, TimeLimit
from limberjack.cli.output import misuse_reported
from limberjack.cli.playing import Playing

__all__: list[str] = []


@app.command("solve")
def _solve(
    domain: Domain,
    task: TaskName,
    episodes: Annotated[int, typer.Option(min=1, help="How many to play.")] = 1,
    seed: FirstSeed = 0,
    time_limit: TimeLimit = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write the recordings, report.html, result.json and video.mp4 here."
        ),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="That simulate; all usable cores by default.")
    ] = None,
) -> None:
    """Play episodes of a task with the planner, which simulates what would follow its actions.

    It plans from the simulator's full state, not from observations. The same seed gives the same
    episode at any number of threads. With --out each episode is recorded, for `limberjack replay`.
    """
    with misuse_reported():
        solving = _Solving(domain, task, range(seed, seed + episodes), time_limit, out, threads)
    raise typer.Exit(solving.finish())


class _Solving(Playing):
    """One call of `limberjack solve`."""

    expected = (OSError,)  # a recording that cannot be written

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: range,
        time_limit: float | None,
        out: Path | None,
        threads: int | None,
    ) -> None:
        """Checks everything that was asked for; raises ValueError or OSError."""
        self._out = out
        self._threads = threads
        if out is not None:
            _check_folder(out, {"domain": domain, "task": task, "policy": "planner"})
        super().__init__(domain, task, seeds, "planner", time_limit, out)

    def _prepare(self, environment: Any) -> None:
        from limberjack.planner import cost_for

        cost_for(environment.task)

    def _play_in(self, environment: Any, seed: int, on_step: Callable[[int, float], None]) -> Any:
        from limberjack import report
        from limberjack.planner import Planner
        from limberjack.planner.record import record_episode
        from limberjack.rollout import Episode

        planner = Planner(environment, self._threads, seed)
        start: list[str | None] = []

        def notice(steps: int, total: float) -> None:
            if not steps:
                start.append(environment.task.start(environment.physics))
            on_step(steps, total)

        versions = {"versions": report.versions(), "fingerprint": self._fingerprint}
        about = {**self._about, "seed": seed, **versions}
        recording = record_episode(environment, planner.act, about, notice)
        if self._out is not None:
            path = self._out / f"episode-{seed}.npz"
            recording.save(path)
            self._recordings.append(path)
        return Episode(seed, start[0], recording.rewards)


def _check_folder(out: Path, expected: dict[str, str]) -> None:
    """Raises ValueError if the folder holds results that recordings must not be mixed with."""
    if (out / "episodes.jsonl").exists():
        raise ValueError(f"{out} holds an evaluation: choose another folder")
    try:
        result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return
    except ValueError:
        result = None
    told = result if isinstance(result, dict) else {}
    for name, value in expected.items():
        if told.get(name) != value:
            raise ValueError(
                f"{out} holds results with {name} {told.get(name)!r}, and these have {value!r}: "
                "choose another folder"
            )
