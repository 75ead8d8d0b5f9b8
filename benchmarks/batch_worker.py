"""Steps a peer of Limberjack's batches on command; runs in the peer's own virtual environment.

    python batch_worker.py

It reads JSON lines on standard input and answers each with one on standard output:

    {"do": "make", "peer": "envpool", "domain": "humanoid", "task": "walk", "num_envs": 64,
     "num_threads": 2}                        -> {"peer": "EnvPool 1.2.5", "mujoco": "3.6.0"}
    {"do": "play", "shape": [8, 64, 21]}      -> {"seconds": 0.1}

The second command is followed by the actions, as float64. Only steps are timed, not the transfer
through pipes. It imports only NumPy and the peer.
"""

import importlib
import importlib.metadata
import json
import os
import re
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

__all__ = ["envpool_name", "main", "make_async", "make_envpool"]

_VERSION = re.compile(rb"\x00(\d\.\d{1,2}\.\d{1,2})\x00")


def make_envpool(domain: str, task: str, num_envs: int, num_threads: int) -> Any:
    """EnvPool's environment, with its Gymnasium interface."""
    envpool: Any = importlib.import_module("envpool")
    name = envpool_name(domain, task)
    return envpool.make_gymnasium(name, num_envs=num_envs, num_threads=num_threads, seed=0)


def envpool_name(domain: str, task: str) -> str:
    """A task's name in EnvPool: 'StackerStack2-v1' for stacker, stack_2."""
    return "".join(word[:1].upper() + word[1:] for word in f"{domain}_{task}".split("_")) + "-v1"


def make_async(domain: str, task: str, num_envs: int, num_threads: int) -> Any:
    """Gymnasium's environment with one process per dm_control simulation, through Shimmy."""
    peers: Any = importlib.import_module("peers")
    gymnasium: Any = importlib.import_module("gymnasium")
    peers.suite(peers.THEIRS)  # makes it loadable on MuJoCo 4.0
    gymnasium.register_envs(importlib.import_module("shimmy"))

    def one() -> Any:
        name = f"{peers.THEIRS}/{domain}-{task}-v0"
        return gymnasium.make(name, disable_env_checker=True)

    # Forked, so that the changes to dm_control apply there.
    return gymnasium.vector.AsyncVectorEnv([one] * num_envs, context="fork")


_MAKERS = {"envpool": make_envpool, "async": make_async}


def _describe(peer: str) -> dict[str, str]:
    """Versions of the peer and of the MuJoCo that it runs."""
    version = importlib.metadata.version
    if peer == "envpool":
        return {"peer": f"EnvPool {version('envpool')}", "mujoco": _linked_mujoco("envpool")}
    names = [f"{name} {version(name)}" for name in ("gymnasium", "shimmy", "dm_control")]
    return {"peer": ", ".join(names), "mujoco": version("mujoco")}


def _linked_mujoco(package: str) -> str:
    """The version of the MuJoCo linked into a package's library, from a text in that file."""
    root = Path(importlib.import_module(package).__file__ or "").parent
    found = {
        match.decode()
        for library in root.glob("mujoco/*dmc*.so")
        for match in _VERSION.findall(library.read_bytes())
    }
    return " or ".join(sorted(found)) or "unknown"


def _play(env: Any, actions: np.ndarray) -> float:
    start = time.perf_counter()
    for action in actions:
        env.step(action)
    return time.perf_counter() - start


def main(commands: BinaryIO, answers: BinaryIO) -> None:
    """Executes commands until its input ends."""
    env: Any = None
    for line in commands:
        command = json.loads(line)
        if command.pop("do") == "make":
            peer = command.pop("peer")
            env = _MAKERS[peer](**command)
            env.reset()
            answer: Any = _describe(peer)
        else:
            shape = command["shape"]
            given = commands.read(8 * int(np.prod(shape)))
            answer = {"seconds": _play(env, np.frombuffer(given).reshape(shape))}
        answers.write(json.dumps(answer).encode() + b"\n")
        answers.flush()
    if env is not None:
        env.close()


if __name__ == "__main__":
    os.environ["MUJOCO_GL"] = "disable"  # before dm_control is imported, which looks for a display
    # The peer's output must not mix with the answers.
    channel = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    main(sys.stdin.buffer, channel)
