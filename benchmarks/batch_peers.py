"""Batches of other packages, each installed in a separate virtual environment.

    folder = batch_peers.install("envpool", Path("peers"))
    with batch_peers.Peer("envpool", folder, "humanoid", "walk", 64, num_threads=2) as peer:
        seconds = peer.play(actions)     # (steps, num_envs, nu)

A peer runs in a separate process (`batch_worker.py`), which is idle between commands.
"""

import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import fresh
import numpy as np

__all__ = ["ASYNC", "ENVPOOL", "Peer", "PeerEndedError", "install"]

ENVPOOL, ASYNC = "envpool", "async"

# pip requirements: the newest versions that install.
_REQUIREMENTS = {ENVPOOL: ["envpool"], ASYNC: ["gymnasium", "shimmy[dm-control]", "packaging"]}
_HERE = Path(__file__).resolve().parent


def install(peer: str, root: Path | None) -> Path | None:
    """The folder of a peer's virtual environment, created if missing.

    None, and a message, if pip fails; None if there is no folder for peers.
    """
    if root is None:
        return None
    folder = root / f"{peer}-python-{sys.version_info[0]}.{sys.version_info[1]}"
    complete = folder / "complete"
    if complete.exists():
        return folder
    print(f"installing: {' '.join(_REQUIREMENTS[peer])}", file=sys.stderr)
    venv.create(folder, clear=True, with_pip=True)
    pip = [str(fresh.python_of(folder)), "-m", "pip", "install", "-qq", "--upgrade"]
    done = subprocess.run([*pip, "--disable-pip-version-check", *_REQUIREMENTS[peer]], check=False)
    if done.returncode:
        message = f"{peer} could not be installed: comparisons with it are not measured"
        print(message, file=sys.stderr)
        return None
    complete.touch()
    return folder


class PeerEndedError(RuntimeError):
    """A peer's process has ended: its standard error has the reason, or it was out of memory."""


class Peer:
    """A peer's environments of one task, at the start of an episode."""

    def __init__(
        self, peer: str, folder: Path, domain: str, task: str, num_envs: int, num_threads: int
    ) -> None:
        """Starts the process and creates the environments.

        Raises:
          PeerEndedError: its process has ended.
        """
        self.num_envs = num_envs
        self._process = subprocess.Popen(
            [str(fresh.python_of(folder)), str(_HERE / "batch_worker.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # Without this process's module search path, so that the peer does not use our packages.
            env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        )
        named = {"domain": domain, "task": task, "num_envs": num_envs, "num_threads": num_threads}
        described = self._ask({"do": "make", "peer": peer, **named})
        self.name: str = described["peer"]
        self.mujoco: str = described["mujoco"]

    def play(self, actions: np.ndarray) -> float:
        """Seconds for steps with the given actions, (steps, num_envs or more, nu)."""
        given = np.ascontiguousarray(actions[:, : self.num_envs], float)
        return self._ask({"do": "play", "shape": given.shape}, given.tobytes())["seconds"]

    def _ask(self, command: dict[str, Any], data: bytes = b"") -> dict[str, Any]:
        commands, answers = self._process.stdin, self._process.stdout
        assert commands is not None
        assert answers is not None
        commands.write(json.dumps(command).encode() + b"\n" + data)
        commands.flush()
        answer = answers.readline()
        if not answer:
            raise PeerEndedError(f"the process has ended with status {self._process.wait()}")
        return json.loads(answer)

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *error: object) -> None:
        self._process.communicate()  # closes its input, which ends it
