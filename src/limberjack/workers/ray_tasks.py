"""Units as tasks of Ray Core; needs the extra `ray`.

    tasks = RayTasks("local", workers=4)           # or the address of a cluster
    for unit, result in tasks.results(function, units):
        ...

A task whose worker or node dies is played again, up to twice. Results come back by value, and only
twice as many units as there are workers are in Ray's hands at a time. Ray started here listens on
this machine only and shows no dashboard.

No other file imports ray.
"""

import logging
import socket
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

from limberjack.utils.requirements import missing_extra
from limberjack.workers.attempt import Answer, Failed, Function, WorkError, attempt, value_of
from limberjack.workers.executors import in_flight
from limberjack.workers.setup import Setup
from limberjack.workers.state import OnState, State
from limberjack.workers.units import Unit

try:
    import ray  # pyright: ignore[reportMissingImports]
    import ray.exceptions  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise missing_extra("ray") from error

__all__ = ["LOCAL", "RayTasks"]

LOCAL = "local"  # in place of an address: Ray on this machine

_RETRIES = 2  # of a unit that has lost its worker: three attempts in all
_LOOK = 1.0  # seconds between two checks of the nodes
_CONNECT = 10.0  # seconds in which the head of a cluster must answer

_Result = TypeVar("_Result")


class RayTasks:
    """See the module's docstring."""

    def __init__(self, address: str, workers: int | None, on_state: OnState | None = None) -> None:
        """Connects to a cluster, or starts one on this machine.

        Args:
          address: of a cluster, such as 'auto' or 'host:6379'; 'local' to start one.
          workers: units at a time; by default one per processor core of the cluster.
          on_state: called as units begin and end.

        Raises:
          WorkError: there is no cluster at that address.
        """
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            _connect(address, workers)
        self._workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._on_state = on_state
        self._running: dict[object, Unit] = {}  # by Ray's reference to the answer
        self._setups: dict[str, object] = {}  # Ray's references, by key
        self._nodes = _living_nodes()
        self._looked = 0.0
        self._task = ray.remote(num_cpus=1, max_retries=_RETRIES, retry_exceptions=False)(_attempt)

    def results(
        self, function: Function[_Result], units: Iterable[Unit]
    ) -> Iterator[tuple[Unit, _Result]]:
        """The units with their results, in the order in which they end.

        Raises:
          WorkError: a unit failed, or lost its worker three times.
        """

        shared = ray.put(function)  # once, as setups

        def submit(unit: Unit) -> object:
            return self._task.remote(shared, self._shared(unit.setup), unit.seeds, *unit.more)

        def value(reference: object, unit: Unit) -> _Result:
            try:
                answer: Answer[_Result] | Failed = ray.get(reference)
            except ray.exceptions.RayError as error:
                first = " ".join(str(error).split())
                raise WorkError(f"{unit} lost {_RETRIES + 1} workers: {first}") from error
            return value_of(answer)

        try:
            yield from in_flight(units, self._workers, self._running, submit, self._ended, value)
        finally:
            self._cancel()

    def close(self) -> None:
        """Cancels what is running, and ends the Ray that was started here."""
        self._cancel()
        self._setups.clear()
        if self._is_ours:
            ray.shutdown()

    def _cancel(self) -> None:
        for reference in self._running:
            ray.cancel(reference, force=True)
        self._running.clear()

    def _shared(self, setup: Setup) -> object:
        """The setup in Ray's store, where all tasks of a node read it."""
        if setup.key not in self._setups:
            self._setups[setup.key] = ray.put(setup)
        return self._setups[setup.key]

    def _ended(self) -> list[object]:
        """Reports the state, and waits for a job to end; returns it, or nothing after a while."""
        self._report()
        return ray.wait(list(self._running), num_returns=1, timeout=_LOOK)[0]

    def _report(self) -> None:
        """Reports the number of running units, and nodes that have been lost since."""
        if self._on_state is None:
            return
        state = State(self._workers, min(self._workers, len(self._running)))
        self._on_state(state)
        if time.monotonic() < self._looked + _LOOK:
            return
        self._looked, known = time.monotonic(), self._nodes
        self._nodes = _living_nodes()
        for node in sorted(known.keys() - self._nodes.keys()):
            note = f"node {known[node]} was lost: its units are played again"
            self._on_state(State(state.workers, state.playing, note=note))


def _attempt(
    function: Function[_Result], setup: Setup, seeds: Sequence[int], *more: object
) -> "Answer[_Result] | Failed":
    """`attempt` under a name of this module, which Ray shows."""
    return attempt(function, setup, seeds, *more)


def _connect(address: str, workers: int | None) -> None:
    _check_reachable(address)
    quiet = {"log_to_driver": False, "logging_level": logging.ERROR}
    try:
        if address == LOCAL:
            ray.init(
                address=LOCAL,
                num_cpus=workers,
                include_dashboard=False,
                _node_ip_address="127.0.0.1",
                **quiet,
            )
        else:
            ray.init(address=address, **quiet)
    except Exception as error:  # the class that Ray raises where a node starts too slowly
        text = " ".join(str(error).split())
        raise WorkError(f"no Ray cluster at {address!r}: {text}") from error


def _check_reachable(address: str) -> None:
    """Raises WorkError if nothing listens there; Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    if not port.isdecimal():  # 'auto' and 'local'
        return
    host = host.rpartition("/")[2].strip("[]")  # without 'ray://'
    try:
        socket.create_connection((host, int(port)), _CONNECT).close()
    except (OSError, OverflowError) as error:
        raise WorkError(f"no Ray cluster at {address!r}: {error}") from error


def _living_nodes() -> dict[str, str]:
    """Addresses of the nodes that are alive, by id."""
    return {node["NodeID"]: node["NodeManagerAddress"] for node in ray.nodes() if node["Alive"]}
