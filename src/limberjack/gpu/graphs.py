"""`Graphs`: records sequences of kernels, and replays them with one call each.

    graphs = Graphs(device, uses_graphs=True)
    graphs.run(("advance", 5), lambda: advance(5))      # runs it
    graphs.run(("advance", 5), lambda: advance(5))      # records it and replays the record
    graphs.run(("advance", 5), lambda: advance(5))      # replays

A record keeps pointers: the arrays that it reads and writes must stay where they are.
"""

import contextlib
import gc
from collections.abc import Callable, Hashable, Iterator

from limberjack.gpu.backend import warp

__all__ = ["Graphs"]


class Graphs:
    """See the module's docstring."""

    def __init__(self, device: object, uses_graphs: bool) -> None:
        """Without `uses_graphs` every call runs as it is."""
        self._device = str(device)
        self._uses_graphs = uses_graphs
        self._has_run: set[Hashable] = set()
        self._records: dict[Hashable, object] = {}

    def run(self, key: Hashable, body: Callable[[], None]) -> None:
        """Runs the kernels of `body`, which is the same function for the same key."""
        record = self._records.get(key)
        if record is not None:
            warp.capture_launch(record)
            return
        if not self._uses_graphs or key not in self._has_run:
            self._has_run.add(key)  # the first time, modules are compiled and loaded
            body()
            return
        with _no_collection(), warp.ScopedCapture(self._device) as capture:
            body()
        self._records[key] = capture.graph
        warp.capture_launch(capture.graph)


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Context without garbage collection: freeing an array would be recorded too."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
