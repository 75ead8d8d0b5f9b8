"""`sb3:PATH`: models that Stable-Baselines3 has saved, as policies.

    actor = saved_policy("sb3:walk.zip", environment)
    act = actor.begin_alone(environment, seed)

A model is shown 64 rows, as in `limberjack.evaluation`, so that an episode is the same, bit for
bit, whichever command plays it. `limberjack.sb3` reads the file.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import dm_env

from limberjack.policies.actors import Alone, Batched
from limberjack.policies.kinds import Act, Actor, PolicyError
from limberjack.utils.files import read_regular
from limberjack.utils.log import log

if TYPE_CHECKING:
    from limberjack.sb3 import SavedPolicy

__all__ = ["is_saved_model", "load_model", "read_model", "saved_policy"]

_PREFIX = "sb3:"


def is_saved_model(policy: object) -> bool:
    """Whether a policy is named as a file, `sb3:PATH`, and not as MODULE:CALLABLE."""
    return isinstance(policy, str) and policy.startswith(_PREFIX)


def read_model(name: str) -> dict[Path, bytes]:
    """The files of the saved model of that name, `sb3:PATH`: its own first.

    Raises:
      PolicyError: a file cannot be read.
    """
    path = Path(name.removeprefix(_PREFIX))
    if path.is_dir():  # 'sb3:' without a path, too
        raise PolicyError(
            f"policy {name!r}: {path} is a folder; expected the file that model.save wrote"
        )
    if not path.exists() and path.suffix != ".zip":
        path = path.with_name(f"{path.name}.zip")
    beside = path.with_suffix(".vecnormalize.pkl")
    try:
        files = (path, *([beside] if beside.exists() else []))
        return {file: read_regular(file) for file in files}
    except (OSError, ValueError) as error:
        raise PolicyError(f"policy {name!r}: {error}") from error


def load_model(
    name: str, environment: dm_env.Environment, files: Mapping[Path, bytes] | None = None
) -> "SavedPolicy":
    """The saved model of that name, `sb3:PATH`, for an environment.

    Args:
      name: of the model.
      environment: the one to act in.
      files: as `read_model` returns them; None to read them.

    Raises:
      PolicyError: Stable-Baselines3 is not installed, a file cannot be read, or the model has
        other observations or actions than the environment.
    """
    try:
        from limberjack import sb3
    except ImportError as error:
        raise PolicyError(f"policy {name!r}: {error}") from None
    if files is None:
        files = read_model(name)
        log.warning("policy %r is a pickle, and loading it runs the Python code in it", name)
    try:
        return sb3.SavedPolicy(files, environment)
    except ValueError as error:
        raise PolicyError(f"policy {name!r}: {error}") from error


def saved_policy(
    name: str, environment: dm_env.Environment | None, files: Mapping[Path, bytes] | None = None
) -> Actor:
    """The policy of a saved model; its episodes are independent of each other.

    Args:
      name: `sb3:PATH`.
      environment: the one to act in. With None the model is loaded, and checked, as its first
        episode begins.
      files: as for `load_model`.

    Raises:
      PolicyError: as `load_model`.
    """
    if environment is not None:
        model = load_model(name, environment, files)
        sha256 = hashlib.sha256(b"".join(model.files.values())).hexdigest()
        return Batched(name, sha256, model.act_batch)
    loaded: list[Actor] = []

    def begin_alone(environment: dm_env.Environment, seed: int) -> Act:
        if not loaded:
            loaded.append(saved_policy(name, environment, files))
        return loaded[0].begin_alone(environment, seed)

    return Alone(name, None, begin_alone)
