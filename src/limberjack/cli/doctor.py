"""`limberjack doctor`: a report on what works on this machine."""

import dataclasses
import json as json_module
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.output import FAILED
from limberjack.cli.progress import show_parts

if TYPE_CHECKING:
    from limberjack.doctor import Backend, Check, Diagnosis, Threads
    from limberjack.doctor.exactness import Comparison, Departure
    from limberjack.doctor.probes import Answer

__all__: list[str] = []

_LABEL_WIDTH = 16  # characters
_PROBES = 9  # that are asked once


@command("doctor", "limberjack doctor", "limberjack doctor --exact", "limberjack doctor --json")
def _doctor(
    exact: Annotated[
        bool,
        typer.Option("--exact", help="Compare the bits of all tasks with those of other machines."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Show what works on this machine, and what to do about what does not.

    Versions, cores, the best number of threads for a small batch, OpenGL, extras, ffmpeg, and
    whether an installed dm_control loads. It takes about ten seconds. The exit status is 0 if a
    short episode steps as it should.

    With --exact: plays each task for a moment, single and in a batch, and compares every reward and
    observation with those stored for this kind of processor, or the nearest. Other processors and
    systems round differently, so a departure is no fault, and the exit status is 0. It is 1 if a
    batch differs from single environments.
    """
    if exact:
        _compare_bits(json)
        return
    from limberjack import doctor

    with show_parts() as show:
        diagnosis = doctor.examine(_asking(show))
    _print(diagnosis, None if json else _lines(diagnosis))
    if not diagnosis.core.works:
        raise typer.Exit(FAILED)


def _compare_bits(json: bool) -> None:
    """Prints where the bits of this machine depart from stored ones."""
    with show_parts() as show:
        from limberjack.doctor import exactness

        found = exactness.compare(on_progress=show)
    _print(found, None if json else _lines_on_bits(found))
    if found.unequal_batches:
        raise typer.Exit(FAILED)


def _print(found: "Diagnosis | Comparison", lines: Iterator[tuple[str, str]] | None) -> None:
    """Prints labels and texts, or everything as JSON."""
    if lines is None:
        typer.echo(json_module.dumps(dataclasses.asdict(found), indent=2))
        return
    for label, text in lines:
        typer.echo(f"{label:{_LABEL_WIDTH}}{text}".rstrip())


def _lines_on_bits(found: "Comparison") -> Iterator[tuple[str, str]]:
    """Labels and texts."""
    yield "here", str(found.here)
    yield "stored", str(found.stored)
    if found.is_equal:
        yield "bits", f"bit-equal: {found.tasks} tasks, single and batched"
    else:
        first, departed = found.departures[0], len(found.departures)
        largest = max(one.largest for one in found.departures)
        yield "bits", f"{found.tasks - departed} of {found.tasks} tasks are bit-equal"
        yield "first departure", _worded_departure(first)
        yield "largest", f"{largest:.1e} at the stored steps of any task"
        yield "", "Results here are as valid; episodes differ. See docs/exactness.md"
    if not found.unequal_batches:
        yield "batches", "bit-equal with single environments of this machine"
        return
    yield "PROBLEM", "a batch differs from single environments of this machine; please report it:"
    yield "", _worded_departure(found.unequal_batches[0])


def _worded_departure(first: "Departure") -> str:
    amounts = ", ".join(
        f"by {one.difference:.1e} at step {one.step}" if one.difference else f"equal at {one.step}"
        for one in first.amounts
    )
    return f"{first.task} ({first.how}), step {first.step}, {first.field}: {amounts}"


def _asking(show: Callable[[str, float, float], None]) -> "Callable[..., Answer]":
    """A function that asks a probe, after showing its name."""
    from limberjack.doctor import probes

    asked, parts = 0, _PROBES

    def ask(probe: str, variables: Mapping[str, str] | None = None) -> "Answer":
        nonlocal asked, parts
        show(f"checking {probe}", asked, max(parts, asked + 1))
        asked += 1
        answer = probes.ask(probe, variables)
        if probe == "backends":  # each of them is asked for a picture
            parts += len(answer.value or ())
        return answer

    return ask


def _lines(diagnosis: "Diagnosis") -> Iterator[tuple[str, str]]:
    """Labels and texts, with empty ones between the parts."""
    core = diagnosis.core
    yield "environments", "step" if core.works else f"do not step: {core.why}"
    yield from ((name, version or "not installed") for name, version in diagnosis.versions.items())
    yield "system", diagnosis.system
    yield "", ""
    yield "cores", f"{diagnosis.usable_cores} usable of {diagnosis.total_cores}"
    yield "threads", _speeds(diagnosis.threads)
    yield "", ""
    yield from _drawing_lines(diagnosis)
    yield "", ""
    for extra in diagnosis.extras:
        missing = f"lacks {', '.join(extra.missing)}: {extra.command}"
        yield f"extra {extra.name}", missing if extra.missing else "installed"
    yield "ffmpeg", diagnosis.ffmpeg.version or f"none: {diagnosis.ffmpeg.why}"
    yield from (("domain " + name, module) for name, module in diagnosis.domains.items())
    yield "dm_control", _worded(diagnosis.dm_control)
    gpu = diagnosis.gpu
    yield "gpu", gpu.version if gpu.works and gpu.version else f"none: {gpu.why}"
    if diagnosis.problems:
        yield "", ""
    for problem in diagnosis.problems:
        first, *others = problem.splitlines()
        yield "PROBLEM", first
        yield from (("", line) for line in others)  # commands, to be copied


def _drawing_lines(diagnosis: "Diagnosis") -> Iterator[tuple[str, str]]:
    used = diagnosis.drawing
    yield "pictures", f"by {used.name}: {_worded_backend(used)}" if used.works else used.why
    for name, value in diagnosis.variables.items():
        if value is not None:
            yield "", f"{name}={value}"
    for backend in diagnosis.backends:
        yield f"  {backend.name}", _worded_backend(backend)
    for number, renderer in enumerate(diagnosis.devices):
        yield f"  EGL device {number}", renderer or "gives no OpenGL"


def _worded(dm_control: "Check") -> str:
    if dm_control.version is None:
        return dm_control.why
    verdict = "loads here" if dm_control.works else f"does not load here: {dm_control.why}"
    return f"{dm_control.version} {verdict}"


def _worded_backend(backend: "Backend") -> str:
    if not backend.works:
        return f"does not work: {backend.why}"
    return ", ".join(filter(None, (backend.renderer, backend.vendor))) or "works"


def _speeds(threads: "Threads") -> str:
    if threads.recommended is None:
        return f"not measured: {threads.why}"
    speeds = ", ".join(f"{n}: {speed:,.0f}" for n, speed in threads.steps_per_second.items())
    return (
        f"num_threads={threads.recommended} for {threads.num_envs} rows of "
        f"{threads.domain}:{threads.task} (steps/s by threads: {speeds})"
    )
