"""`limberjack replay`: a recorded episode again, bit for bit."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from limberjack.cli.app import app
from limberjack.cli.output import FAILED, complain, misuse_reported

if TYPE_CHECKING:
    from limberjack.planner.record import Recording

__all__: list[str] = []


@app.command("replay")
def _replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An episode-*.npz.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write video.mp4 and the plots here.")
    ] = None,
) -> None:
    """Play a recorded episode again, without the planner, and say whether every bit is the same.

    Compares states, rewards and observations of all steps. The exit status is 1 where they differ,
    as they may with another version of MuJoCo or on another kind of processor; --out then writes
    nothing.
    """
    with misuse_reported():
        from limberjack import report
        from limberjack.planner.record import Recording

        recording = Recording.load(file)
        environment = _environment_of(recording, file)
        other = _versions_differ(recording, environment)
        _check_out(out, file)
        recorder = None if out is None else report.Recorder(out)
    with contextlib.closing(environment), misuse_reported():
        try:
            difference = _played(recording, environment, recorder)
        except ValueError as error:
            raise ValueError(f"{file}: {error}.{other}") from error
    if difference is not None:
        complain(f"{file}: {difference}.{other}")
        raise typer.Exit(FAILED)
    total = float(recording.rewards.sum())
    typer.echo(f"{file}: {len(recording.rewards)} steps, return {total:.3f}, every bit the same")


def _played(recording: "Recording", environment: Any, recorder: Any) -> str | None:
    """Where the recording differs; if nowhere, the recorder writes what was seen.

    recorder: a `report.Recorder`, or None.
    """
    from limberjack.planner.record import replay

    start: list[str | None] = []
    steps = 0

    def on_step() -> None:
        nonlocal steps
        if recorder is not None and not steps:
            start.append(environment.task.start(environment.physics))
            recorder.begin(environment)
        if recorder is not None:
            recorder.add_step(steps)
        steps += 1

    difference = replay(recording, environment, on_step)
    if recorder is not None and difference is None:
        recorder.finish_film()
        _write(recorder, recording, start[0], environment.control_timestep())
    elif recorder is not None:
        recorder.drop_film()
    return difference


def _environment_of(recording: "Recording", file: Path) -> Any:
    """An environment of the recording's task and length."""
    from limberjack import suite

    about = recording.about
    missing = [name for name in ("domain", "task", "time_limit") if name not in about]
    if missing:
        raise ValueError(f"{file} does not say its {', '.join(missing)}, so it cannot be played")
    task_kwargs = {"random": 0, "time_limit": about["time_limit"]}
    return suite.load(about["domain"], about["task"], task_kwargs=task_kwargs)


def _check_out(out: Path | None, file: Path) -> None:
    """Raises where files would take the place of those that tell of the recording."""
    if out is None or out.resolve() != file.parent.resolve():
        return
    if (out / "result.json").exists():
        raise ValueError(
            f"--out is {out}, where {file.name} lies beside a result.json that tells of all its "
            "episodes: choose another folder"
        )


def _write(
    recorder: Any, recording: "Recording", start: str | None, control_timestep: float
) -> None:
    """Writes what the recorder has; recorder: a `report.Recorder`."""
    from limberjack.rollout import Episode

    about = {"policy": "recorded", "control_timestep": control_timestep, **recording.about}
    fingerprint = str(about.pop("fingerprint", ""))
    about.pop("versions", None)
    episode = Episode(int(about.get("seed", 0)), start, recording.rewards)
    recorder.write({**about, "episodes_asked_for": 1}, [episode], fingerprint)
    for line in recorder.left_out:
        complain(line)
    for path in recorder.written:
        typer.echo(path)


def _versions_differ(recording: "Recording", environment: Any) -> str:
    """A sentence on versions and a model that are not the recorded ones; empty if all are."""
    from limberjack import report

    recorded = recording.about.get("versions", {})
    other = [f"{n} {recorded.get(n)}, here {v}" for n, v in report.versions().items()
             if recorded.get(n) != v]  # fmt: skip
    fingerprint = recording.about.get("fingerprint")
    if fingerprint not in (None, report.fingerprint(environment.physics.model._model)):
        other.append("a model with another fingerprint")
    return f" It was recorded with {'; '.join(other)}." if other else ""
