"""`limberjack replay`: recorded episodes, played again and compared bit for bit."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.datasets import reading_reported
from limberjack.cli.output import FAILED, complain, misuse_reported
from limberjack.cli.progress import show_episodes, show_units
from limberjack.cli.typed import command_line

if TYPE_CHECKING:
    from limberjack.recording.episodes import Recording
    from limberjack.report import Facts, Recorder
    from limberjack.rl.control import Environment
    from limberjack.rollout import Episode

__all__: list[str] = []

_RECORDED = "recorded"  # the policy of an episode that is played again
_LONGEST = 1e9  # seconds; longer than any episode
# What entries of `Recording.about` must be.
_KINDS: dict[str, type | tuple[type, ...]] = {
    "domain": str,
    "task": str,
    "time_limit": (int, float),
    "seed": int,
    "versions": dict,
    "fingerprint": str,
}


@command(
    "replay",
    "limberjack replay solved/episode-3.npz",
    "limberjack replay solved/episode-3.npz --out again",
    "limberjack replay walk",
)
def _replay(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="An episode-*.npz that `limberjack solve` wrote, or the folder of a dataset that "
            "`limberjack collect` wrote.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write report.html, result.json, return.png and video.mp4 of an episode here.",
        ),
    ] = None,
) -> None:
    """Play recorded episodes again, without their policy, and report whether every bit is equal.

    States, rewards and observations of all steps are compared. If they differ, as they may with
    another version of MuJoCo or on another kind of processor, the exit status is 1 and --out writes
    nothing.
    """
    if file.is_dir():
        _replay_dataset(file, out)
    else:
        _replay_recording(file, out)


def _replay_recording(file: Path, out: Path | None) -> None:
    """Replays a file of the planner's."""
    with misuse_reported():
        from limberjack import report
        from limberjack.recording.episodes import Recording

        recording = Recording.load(file)
        about = _checked_about(recording.about, file)
        environment = _environment_of(about)
        other = _versions_differ(about, environment)
        _check_out(out, file)
        played = {**about, "policy": _RECORDED}
        recorder = None if out is None else report.Recorder(out, played, command_line())
    with contextlib.closing(environment), misuse_reported():
        try:
            difference = _played(recording, about, environment, recorder)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{file}: {error}.{other}") from error
        finally:
            if recorder is not None:
                recorder.close()
    if difference is not None:
        complain(f"{file}: {difference}.{other}")
        raise typer.Exit(FAILED)
    total = float(recording.rewards.sum())
    typer.echo(f"{file}: {len(recording.rewards)} steps, return {total:.3f}, every bit the same")


def _replay_dataset(directory: Path, out: Path | None) -> None:
    with reading_reported("replay"):
        from limberjack import data

        if out is not None:
            raise ValueError(
                f"--out is {out}, and {directory} is a folder: `limberjack record --from "
                f"{directory}` films an episode of a dataset"
            )
        dataset = data.load(directory)
        with show_units() as progress:
            progress.begin(len(dataset))
            difference = data.replay(dataset, on_progress=progress.show)
    if difference is not None:
        complain(difference)
        raise typer.Exit(FAILED)
    typer.echo(f"{directory}: {len(dataset)} episodes, {dataset.steps:,} steps, every bit the same")


def _played(
    recording: "Recording",
    about: "Facts",
    environment: "Environment",
    recorder: "Recorder | None",
) -> str | None:
    """The first difference; if there is none, the recorder writes the episode."""
    from limberjack import rollout
    from limberjack.recording.episodes import replay

    start: str | None = None
    steps = len(recording.rewards)

    def on_step(step: rollout.Step) -> None:
        nonlocal start
        progress.show(0, step.number, steps, step.total)
        if recorder is None:
            return
        if step.action is None:
            start = rollout.kind_of_start(environment)
            recorder.begin(environment)
        with progress.drawing():
            recorder.add_step(step)

    with show_episodes(1, filmed=recorder is not None) as progress:
        difference = replay(recording, environment, on_step)
        if recorder is not None and difference is None:
            recorder.finish_film()
    if recorder is not None and difference is None:
        episode = rollout.Episode(about["seed"], start, recording.rewards)
        _write(recorder, about, episode, environment.control_timestep())
    return difference


def _checked_about(about: "Facts", file: Path) -> "Facts":
    """The entries that describe a recording, with defaults for those that may be missing.

    Raises:
      ValueError: another entry is missing, or one is of another kind than `limberjack solve`
        writes.
    """
    missing = [name for name in ("domain", "task", "time_limit") if name not in about]
    if missing:
        raise ValueError(
            f"{file} cannot be played: it lacks its {', '.join(missing)}; expected an "
            "episode-*.npz that `limberjack solve --out` wrote"
        )
    checked = {"seed": 0, "versions": {}, "fingerprint": "", **about}
    for name, kind in _KINDS.items():
        value = checked[name]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise ValueError(f"{file} cannot be played: its {name} is {value!r}")
    seconds = checked["time_limit"]
    if not (0 < seconds < _LONGEST):
        raise ValueError(f"{file} cannot be played: its time_limit is {seconds}; expected seconds")
    return checked


def _environment_of(about: "Facts") -> "Environment":
    """An environment of the recording's task and length."""
    from limberjack import suite

    task_kwargs = {"random": 0, "time_limit": about["time_limit"]}
    return suite.load(about["domain"], about["task"], task_kwargs=task_kwargs)


def _check_out(out: Path | None, file: Path) -> None:
    """Raises ValueError if files would replace those of the run that the recording is from."""
    if out is None or out.resolve() != file.parent.resolve():
        return
    if (out / "result.json").exists():
        raise ValueError(
            f"--out is {out}, which holds {file.name} and the result.json of its run: choose "
            "another folder"
        )


def _write(
    recorder: "Recorder", about: "Facts", episode: "Episode", control_timestep: float
) -> None:
    """Writes the files of the recorded episode, and prints their names."""
    run = {name: about[name] for name in ("domain", "task", "time_limit")}
    run |= {"policy": _RECORDED, "control_timestep": control_timestep, "episodes_asked_for": 1}
    recorder.write(run, [episode], about["fingerprint"])
    for line in recorder.left_out:
        complain(line)
    for path in recorder.written:
        typer.echo(path)


def _versions_differ(about: "Facts", environment: "Environment") -> str:
    """A sentence on versions and a model that differ from the recorded ones; empty if none do."""
    from limberjack import report

    recorded = about["versions"]
    other = [
        f"{n} {recorded.get(n)}, here {v}"
        for n, v in report.versions().items()
        if recorded.get(n) != v
    ]
    if about["fingerprint"] not in ("", report.fingerprint(environment.physics.model._model)):
        other.append("a model with another fingerprint")
    return f" It was recorded with {'; '.join(other)}." if other else ""
