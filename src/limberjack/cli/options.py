"""Arguments and options that several commands have, described in the same words."""

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from limberjack import registry
from limberjack.cli.output import append_working_directory
from limberjack.utils.files import read_regular
from limberjack.utils.seeds import SEEDS
from limberjack.utils.suggest import did_you_mean

if TYPE_CHECKING:
    from limberjack.workers.factories import Make
    from limberjack.worlds import World

__all__ = [
    "ActionRepeat",
    "AnyProcessor",
    "Appearance",
    "Camera",
    "Domain",
    "EnvironmentName",
    "Episodes",
    "Faults",
    "OptionalDomain",
    "Out",
    "PolicyName",
    "Ray",
    "RequiredOut",
    "Seed",
    "Seeds",
    "Shard",
    "TaskName",
    "TaskSet",
    "Threads",
    "TimeLimit",
    "Vectorised",
    "Workers",
    "camera_named",
    "chosen_seeds",
    "folder_named",
    "function_named",
    "named_environment",
    "named_task",
    "refuse_beside",
    "shard_named",
    "world_named",
]

_DOMAIN = typer.Argument(
    metavar="DOMAIN",
    help="Such as humanoid; `limberjack list` shows all, `limberjack --import` adds one. "
    "DOMAIN/TASK, such as humanoid/walk, names both.",
    show_default=False,
)
Domain = Annotated[str, _DOMAIN]
OptionalDomain = Annotated[str | None, _DOMAIN]
TaskName = Annotated[
    str | None,
    typer.Argument(metavar="TASK", help="Such as walk.", show_default=False),
]
PolicyName = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="What acts: zero, random, planner, pretrained, MODULE:CALLABLE, or a file: mlp:PATH, "
        "onnx:PATH, sb3:PATH.",
    ),
]
EnvironmentName = Annotated[
    str | None,
    typer.Option(
        "--env",
        metavar="MODULE:FUNCTION",
        help="In the place of DOMAIN TASK: a function make(seed) that makes an environment. Its "
        "module may be in the working directory.",
    ),
]
TaskSet = Annotated[
    str | None,
    typer.Option(
        "--set",
        metavar="NAME",
        help="In the place of DOMAIN TASK: a set of tasks, such as dmc28, or a list, such as "
        "walker:walk,fish:swim. In names of policies {domain} and {task} stand for each task's.",
    ),
]
Camera = Annotated[
    str | None,
    typer.Option(help="Its name or number; -1 is the free camera; the model's first by default."),
]
Seed = Annotated[int, typer.Option(metavar="N", min=0, max=SEEDS - 1, help="Of the episode.")]
Seeds = Annotated[
    str | None,
    typer.Option(
        metavar="A:B", help="One episode for each seed from A to B-1, or A for one episode."
    ),
]
Episodes = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        max=SEEDS,
        help="The first seeds only; without --seeds, those from 0 on.",
    ),
]


def folder_named(text: str) -> Path:
    """The folder of an option."""
    if not text:  # such as a variable of the shell that is not set; Path("") is the present folder
        raise typer.BadParameter("it is empty; expected a folder")
    if "://" in text:  # of which Path would make a folder here
        raise typer.BadParameter(
            f"{text} is a URL; expected a folder: only `limberjack collect` writes to a URL"
        )
    return Path(text)


_OUT = typer.Option(metavar="DIR", parser=folder_named, help="Write the results into this folder.")
Out = Annotated[Path | None, _OUT]
RequiredOut = Annotated[Path, _OUT]
Threads = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="Threads that step the batch, or of each worker; by default all cores.",
    ),
]
TimeLimit = Annotated[
    float | None, typer.Option(metavar="X", help="Seconds per episode; the task's own by default.")
]
_MOST_REPEATS = 1_000_000  # more than any episode has control steps
ActionRepeat = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        max=_MOST_REPEATS,
        help="Control steps per action; the environment's own by default, mostly 1. Returns and "
        "lengths still count control steps.",
    ),
]
Vectorised = Annotated[
    bool | None,
    typer.Option(
        "--vectorised/--no-vectorised",
        help="Step all rows with one call of the task's code, or complete environments; by default "
        "the first where that changes no number.",
        show_default=False,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Processes that play; one that dies is replaced. With --ray, episodes or batches of "
        "64 at a time. No number of workers changes a result.",
    ),
]
Ray = Annotated[
    str | None,
    typer.Option(
        metavar="[ADDRESS]",
        help="Play on a Ray cluster: its address, or none to start Ray on this machine.",
    ),
]
Shard = Annotated[
    str | None,
    typer.Option(
        metavar="K/N",
        help="Play the K-th of N parts of the seeds only, such as 3/8, as one task of a Slurm "
        "array does; the same command without it joins all parts.",
    ),
]
AnyProcessor = Annotated[
    bool,
    typer.Option(
        "--any-processor",
        help="Accept processors that round differently, and record which one played.",
    ),
]

Faults = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Faults of the real world: easy, medium, hard, a file .toml or .json, or a mapping of "
        'JSON, such as {"delay": {"actions": 3}}.',
    ),
]
Appearance = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Another look of pictures: a preset such as color_hard or video_hard=video:DIR, a "
        'file .toml or .json, or a mapping of JSON, such as {"background": "noise"}.',
    ),
]


def world_named(
    env: str | None = None, faults: str | None = None, appearance: str | None = None
) -> "World | None":
    """The options of the world that the options of a command give; None without any.

    Args:
      env: the function of --env, which sets its world itself.
      faults: of --faults.
      appearance: of --appearance.

    Raises:
      ValueError: a name or a value is unknown, a file cannot be read, or there is --env.
    """
    texts = {"faults": faults, "appearance": appearance}
    texts = {name: text for name, text in texts.items() if text is not None}
    if not texts:
        return None
    if env is not None:
        names = " and ".join(f"--{name}" for name in texts)
        raise ValueError(f"got {names} and --env {env}, which makes the environment: set it there")
    from limberjack.worlds.appearance import Appearance
    from limberjack.worlds.faults import Faults

    world = {name: _name_or_mapping(f"--{name}", text) for name, text in texts.items()}
    try:
        if "faults" in world:
            Faults.of(world["faults"])
        if "appearance" in world:
            Appearance.of(world["appearance"])
    except TypeError as error:
        raise ValueError(str(error)) from None
    return world


def _name_or_mapping(option: str, text: str) -> str | dict[str, object]:
    """The content of a file, or a mapping of JSON; any other text is a name.

    Raises:
      ValueError: the file or the text cannot be read.
    """
    path = Path(text)
    if path.suffix in (".toml", ".json"):
        try:
            text = read_regular(path).decode()
        except (OSError, ValueError) as error:  # no UTF-8, too
            raise ValueError(f"{option} {path} cannot be read: {error}") from None
    elif not text.lstrip().startswith("{"):
        return text
    try:
        content = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{option} {path} is no mapping: {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{option} {path} is {content!r}; expected a mapping")
    return content


def shard_named(shard: str | None, out: object) -> tuple[int, int] | None:
    """The numbers in K/N; None without a shard.

    Args:
      shard: as the option gives it.
      out: the folder of the results, which a shard must have.

    Raises:
      ValueError: it is something else, or there is no folder.
    """
    if shard is None:
        return None
    found = re.fullmatch(r"(\d+)/(\d+)", shard)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise ValueError(f"--shard is {shard!r}; expected K/N with K from 1 to N, such as 3/8")
    if out is None:
        raise ValueError(f"--shard {shard} needs --out DIR, a folder that all shards write to")
    return int(found[1]), int(found[2])


def named_task(domain: str, task: str | None) -> tuple[str, str]:
    """The domain and the task that DOMAIN TASK or DOMAIN/TASK names; neither is looked up.

    Raises:
      ValueError: the task is missing or named twice.
    """
    first, slash, second = domain.partition("/")
    if slash and task is not None:
        raise ValueError(f"got {domain} and {task}; expected DOMAIN TASK or DOMAIN/TASK")
    if task is not None:
        return domain, task
    if slash:
        return first, second
    known = registry.domains()
    if domain not in known:
        raise ValueError(
            f"got {domain} without a task; expected DOMAIN TASK or DOMAIN/TASK."
            f"{did_you_mean(domain, known)} `limberjack list` shows all."
        )
    tasks = ", ".join(sorted(row.task for row in known[domain].rows))
    raise ValueError(f"got {domain} without a task; choose one of: {tasks}")


def named_environment(
    domain: str | None, task: str | None, env: str | None, time_limit: float | None = None
) -> "tuple[str | Make, str | None]":
    """The domain and the task, or the function of --env and None.

    Raises:
      ValueError: neither or both are given, there is no such function, or it has a time limit
        beside it.
    """
    if env is None:
        if domain is None:
            raise ValueError(
                "got no task; expected DOMAIN TASK, or --env MODULE:FUNCTION. `limberjack list` "
                "shows all tasks"
            )
        return named_task(domain, task)
    if domain is not None:
        raise ValueError(f"got {domain} and --env {env}; expected one of them")
    if time_limit is not None:
        raise ValueError(
            f"--time-limit is {time_limit}, but --env {env} makes the environment: leave it out, "
            "and set it there"
        )
    return function_named(env), None


def function_named(env: str) -> "Make":
    """The function of --env; raises ValueError if there is none of that name."""
    from limberjack.policies.named import found_named
    from limberjack.rl.builds import takes_a_seed

    append_working_directory()
    make = found_named("--env", env)
    if not callable(make):
        raise ValueError(f"--env {env} is a {type(make).__name__}; expected a function make(seed)")
    if not takes_a_seed(make):
        raise ValueError(f"--env {env} takes no seed; expected a function make(seed)")
    return cast("Make", make)


def camera_named(text: str) -> int | str:
    """The number of a camera if the text is one, and its name otherwise."""
    return int(text) if text.removeprefix("-").isdecimal() else text


def chosen_seeds(seeds: str | None, episodes: int | None, default: int) -> range:
    """The seeds given by their range, their number, or both.

    Args:
      seeds: A:B, or A.
      episodes: the first ones only.
      default: their number, from 0 on, if neither is given.

    Raises:
      ValueError: they are not a range, an empty one, or fewer than the episodes.
    """
    if seeds is None:
        return range(default if episodes is None else episodes)
    found = re.fullmatch(r"(\d+)(?::(\d+))?", seeds)
    if found is None:
        raise ValueError(f"--seeds is {seeds!r}; expected A:B, such as 0:100, from 0 on")
    first = int(found[1])
    chosen = range(first, first + 1 if found[2] is None else int(found[2]))
    if not chosen:
        raise ValueError(f"--seeds is {seeds}, which holds no seed; expected A:B with A below B")
    if chosen[-1] >= SEEDS:
        raise ValueError(f"--seeds is {seeds}; expected numbers up to {SEEDS - 1}")
    if episodes is not None and episodes > len(chosen):
        raise ValueError(
            f"--episodes is {episodes}, but --seeds {seeds} holds {len(chosen)}: give more seeds"
        )
    return chosen[:episodes]


def refuse_beside(others: Mapping[str, object], owner: str) -> None:
    """Raises ValueError if options are given beside one that they do not go with.

    Args:
      others: the values of these options by name; None for those that are not given.
      owner: the option that is given, with the reason.
    """
    given = [name for name, value in others.items() if value is not None]
    if given:
        raise ValueError(f"got {' and '.join(given)} beside {owner}")
