"""The tool that records the bits of this machine."""

from pathlib import Path

import pytest
import record_bits

from limberjack.doctor import exactness
from limberjack.doctor.stored_bits import Kind, StoredBits

_TASKS = (("pendulum", "swingup"), ("cartpole", "balance"))


def test_bits_are_added_to_the_file_and_compared_as_equal(tmp_path: Path) -> None:
    path = tmp_path / "bits.json"
    record_bits.record(path, _TASKS[:1])
    run = record_bits.record(path, _TASKS)
    (stored,) = StoredBits.read(path).runs
    assert stored.kind == run.kind == Kind.here()
    assert exactness.compare(StoredBits.read(path)).is_equal
    assert list(stored.tasks) == ["pendulum:swingup", "cartpole:balance"]


def test_a_batch_that_differs_is_not_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = exactness.played("pendulum", "swingup")
    found.batch["velocity"][4, 1] += 1e-9
    monkeypatch.setattr(record_bits, "played", lambda *_: found)
    path = tmp_path / "bits.json"
    with pytest.raises(RuntimeError, match="pendulum:swingup: velocity of the batch differs"):
        record_bits.record(path, _TASKS[:1])
    assert not path.exists()
