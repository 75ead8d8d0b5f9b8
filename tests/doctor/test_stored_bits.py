"""The stored bits: what is in the file, how it is written, and the kinds of machines."""

import dataclasses
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from limberjack import suite
from limberjack.doctor.stored_bits import FILE, KEPT, Kind, Run, StoredBits, field_of

_KIND = Kind("Linux", "x86_64", "AVX2", "rounded", "2.4.6", "4.0.0")
_LARGEST_FILE = 200_000  # bytes, in a package that is downloaded with everything else


def _values(seed: int = 0) -> np.ndarray:
    return np.random.RandomState(seed).normal(size=(KEPT[-1] + 1, 2, 3))


def test_the_packages_file_is_small_and_has_every_task_of_the_suite() -> None:
    assert FILE.stat().st_size < _LARGEST_FILE
    runs = StoredBits.read().runs
    assert {run.kind.vectors for run in runs} >= {"AVX-512", "AVX2"}
    for run in runs:
        assert list(run.tasks) == [":".join(task) for task in suite.ALL_TASKS]
        for fields in run.tasks.values():
            assert list(fields)[-1] == "reward"
            for field in fields.values():
                assert field.checksums.shape == (KEPT[-1] + 1,)
                assert field.values.shape[0] == len(KEPT)


def test_every_bit_of_every_step_changes_the_checksum() -> None:
    values = _values()
    before = field_of(values).checksums
    for bit in range(64):
        changed = values.copy()
        changed.view(np.uint64)[30, 1, 2] ^= np.uint64(1 << bit)
        differs = field_of(changed).checksums != before
        assert np.flatnonzero(differs).tolist() == [30]


def test_zeros_of_either_sign_and_of_other_lengths_differ() -> None:
    zeros = np.zeros((61, 1))
    assert (field_of(zeros).checksums != field_of(-zeros).checksums).all()
    assert (field_of(zeros).checksums != field_of(np.zeros((61, 2))).checksums).all()


def test_runs_are_read_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "bits.json"
    fields = {"position": field_of(_values()), "reward": field_of(_values(1)[..., 0])}
    first = Run(_KIND, {"walker:walk": fields, "walker:run": fields})
    other = dataclasses.replace(_KIND, vectors="AVX-512")
    stored = StoredBits().with_run(first).with_run(Run(other, first.tasks))
    stored.write(path)
    read = StoredBits.read(path)
    assert [run.kind for run in read.runs] == [_KIND, other]
    for run in read.runs:
        for name, field in fields.items():
            np.testing.assert_array_equal(run.tasks["walker:run"][name].checksums, field.checksums)
            np.testing.assert_array_equal(run.tasks["walker:run"][name].values, field.values)


def test_equal_fields_are_stored_once(tmp_path: Path) -> None:
    one, two = tmp_path / "one.json", tmp_path / "two.json"
    fields = {"position": field_of(_values())}
    StoredBits([Run(_KIND, {"walker:walk": fields})]).write(one)
    StoredBits([Run(_KIND, {"walker:walk": fields, "walker:run": fields})]).write(two)
    assert two.stat().st_size - one.stat().st_size < 60


def test_a_run_takes_the_place_of_one_of_the_same_kind() -> None:
    old, new = Run(_KIND, {}), Run(_KIND, {"walker:walk": {}})
    (left,) = StoredBits([old]).with_run(new).runs
    assert left is new


def test_the_mujoco_version_decides_before_the_machine_and_that_before_numpy() -> None:
    other_numpy = dataclasses.replace(_KIND, numpy="2.0.0")
    other_machine = dataclasses.replace(_KIND, machine="arm64")
    other_mujoco = dataclasses.replace(_KIND, mujoco="4.1.0")
    kinds = [other_mujoco, other_machine, other_numpy, _KIND]
    assert sorted(kinds, key=_KIND.nearness) == kinds


def test_products_are_named_as_the_linear_algebra_rounds_them() -> None:
    def fused(first: float, second: float) -> float:
        return float(Fraction(second) ** 2 + Fraction(first * first))

    pairs = np.random.RandomState(0).normal(size=(1000, 2))
    sums = {
        "fused": [{fused(a, b), fused(b, a)} for a, b in pairs.tolist()],  # in either order
        "rounded": [{a * a + b * b} for a, b in pairs.tolist()],
    }
    differing = sum(not one & other for one, other in zip(*sums.values(), strict=True))
    assert differing > 20  # so that the two can be told apart
    for pair, expected in zip(pairs, sums[Kind.here().products], strict=True):
        assert pair.dot(pair) in expected


@pytest.mark.parametrize(
    ("names", "vectors"),
    [
        ({"baseline": ["X86_V2"], "found": ["X86_V3", "X86_V4", "AVX512_ICL"]}, "AVX-512"),
        ({"baseline": ["SSE", "SSE2"], "found": ["AVX2", "FMA3"]}, "AVX2"),
        ({"baseline": ["NEON", "ASIMD"]}, "NEON"),
        ({"baseline": ["X86_V2"]}, ""),
    ],
)
def test_vectors_are_known_by_the_names_of_several_versions_of_numpy(
    monkeypatch: pytest.MonkeyPatch, names: dict[str, list[str]], vectors: str
) -> None:
    monkeypatch.setattr(np, "show_config", lambda mode: {"SIMD Extensions": names})
    assert Kind.here().vectors == vectors
    assert str(Kind.here()).count(" with ") == bool(vectors)
