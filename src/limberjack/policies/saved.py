"""Policies in files, by the prefix of their names: `sb3:PATH`, `mlp:PATH` and `onnx:PATH`.

    actor = saved_policy("sb3:walk.zip", environment)
    act = actor.begin_alone(environment, seed)

A model is shown 64 rows, as in `limberjack.evaluation`, so that an episode is the same, bit for
bit, whichever command plays it. `limberjack.sb3` reads the files of Stable-Baselines3,
`policies.mlp` those of the format safetensors, and `policies.onnx` those of ONNX. A new kind of
files is one more entry of `_KINDS`.
"""

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

import dm_env

from limberjack.policies import mlp, onnx
from limberjack.policies.actors import Batched, Deferred
from limberjack.policies.kinds import Actor, PolicyError
from limberjack.policies.networks import Network, network_policy
from limberjack.utils.files import read_regular
from limberjack.utils.log import log

__all__ = ["RUNS_CODE", "is_saved_model", "read_model", "runs_code", "saved_policy"]

# Logged as the files are read; commands print it.
RUNS_CODE = (
    "policy %r is a pickle, and loading it runs the Python code in it: use only files of people "
    "whom you trust"
)

_Files = Mapping[Path, bytes]


@dataclasses.dataclass(frozen=True)
class _Kind:
    """A kind of files.

    Attributes:
      written_by: in words.
      check: raises ImportError where a package that it needs is not installed.
      read: the files of the policy at a path, its own first.
      actor: the policy of that name in these files, for an environment; raises PolicyError.
      runs_code: whether reading the policy from the files runs code in them.
    """

    written_by: str
    check: Callable[[], object]
    read: Callable[[Path], dict[Path, bytes]]
    actor: Callable[[str, _Files, dm_env.Environment], Actor]
    runs_code: bool


def is_saved_model(policy: object) -> bool:
    """Whether a policy is named as a file, such as `sb3:PATH`, and not as MODULE:CALLABLE."""
    return isinstance(policy, str) and policy.startswith(_PREFIXES)


def runs_code(policy: str) -> bool:
    """Whether a policy is named as a file of a kind that runs the code in it as it is loaded."""
    return is_saved_model(policy) and _kind(policy).runs_code


def read_model(name: str) -> dict[Path, bytes]:
    """The files of the saved model of that name: its own first.

    Raises:
      PolicyError: a file cannot be read.
    """
    kind, path = _kind(name), Path(name.partition(":")[2])
    if path.is_dir():  # 'sb3:' without a path, too
        raise PolicyError(
            f"policy {name!r}: {path} is a folder; expected the file that {kind.written_by} wrote"
        )
    try:
        files = kind.read(path)
    except (OSError, ValueError) as error:
        raise PolicyError(f"policy {name!r}: {error}") from error
    if kind.runs_code:
        log.warning(RUNS_CODE, name)
    return files


def saved_policy(
    name: str, environment: dm_env.Environment | None, files: _Files | None = None
) -> Actor:
    """The policy of a saved model; its episodes are independent of each other.

    Args:
      name: such as `sb3:PATH`.
      environment: the one to act in. With None the model is loaded, and checked, as its first
        episode begins.
      files: as `read_model` returns them; None to read them.

    Raises:
      PolicyError: a package is not installed, a file cannot be read, or the model has other
        observations or actions than the environment.
    """
    if environment is None:
        return Deferred(name, lambda found: saved_policy(name, found, files))
    kind = _kind(name)
    try:
        kind.check()
    except ImportError as error:
        raise PolicyError(f"policy {name!r}: {error}") from None
    return kind.actor(name, read_model(name) if files is None else files, environment)


def _kind(name: str) -> _Kind:
    return _KINDS[name.partition(":")[0] + ":"]


def _import_sb3() -> object:
    from limberjack import sb3

    return sb3


def _read_sb3(path: Path) -> dict[Path, bytes]:
    """A model, and the normalisation beside it, if there is one."""
    if not path.exists() and path.suffix != ".zip":
        path = path.with_name(f"{path.name}.zip")
    beside = path.with_suffix(".vecnormalize.pkl")
    files = (path, *([beside] if beside.exists() else []))
    return {file: read_regular(file) for file in files}


def _sb3(name: str, files: _Files, environment: dm_env.Environment) -> Actor:
    from limberjack import sb3

    try:
        model = sb3.SavedPolicy(files, environment)
    except ValueError as error:
        raise PolicyError(f"policy {name!r}: {error}") from error
    sha256 = hashlib.sha256(b"".join(model.files.values())).hexdigest()
    return Batched(name, sha256, model.act_batch)


def _read_network(path: Path) -> dict[Path, bytes]:
    return {path: mlp.read(path)}


def _network(
    name: str,
    files: _Files,
    environment: dm_env.Environment,
    parse: Callable[[bytes, str], Network] = mlp.parse,
) -> Actor:
    (content,) = files.values()
    return network_policy(name, content, environment, parse)


_WRITES_NETWORKS = "`limberjack train` or mlp.save"
_WRITES_MODELS = "`limberjack export` or onnx.save"
_KINDS = {
    "sb3:": _Kind("model.save", _import_sb3, _read_sb3, _sb3, runs_code=True),
    "mlp:": _Kind(_WRITES_NETWORKS, lambda: None, _read_network, _network, runs_code=False),
    "onnx:": _Kind(
        _WRITES_MODELS,
        onnx.check_installed,
        _read_network,
        functools.partial(_network, parse=onnx.parse),
        runs_code=False,
    ),
}
_PREFIXES = tuple(_KINDS)
