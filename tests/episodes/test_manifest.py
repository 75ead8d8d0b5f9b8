"""The manifest: what it says, and what is refused of one that anyone may have written."""

import dataclasses
import itertools
import json
import random
from pathlib import Path
from typing import Any

import pytest

from limberjack.data import Dataset, load
from limberjack.episodes.manifest import (
    Manifest,
    file_name,
    named_seeds,
    united,
    without,
)

from .collected import copy, folder_of, hashes


def _content(dataset: Dataset) -> dict[str, Any]:
    return json.loads((folder_of(dataset) / "dataset.json").read_text())


def test_it_lists_the_files_and_their_returns(pendulums: Dataset) -> None:
    content = _content(pendulums)
    folder = folder_of(pendulums)
    assert content["recipe"] == json.loads(json.dumps(pendulums.recipe.as_json()))
    assert content["seeds"] == [[0, 70]]
    assert (content["episodes"], content["steps"]) == (70, 700)
    assert {file["name"]: file["sha256"] for file in content["files"]} == hashes(folder)
    assert [file["rows"] for file in content["files"]] == [64 * 11, 6 * 11]
    returns = [value for file in content["files"] for value in file["returns"]]
    assert returns == [episode.total for episode in pendulums]
    assert set(content["statistics"]) == {
        "observation/orientation", "observation/velocity", "action", "reward",
    }  # fmt: skip


def test_it_is_read_as_it_was_written(pendulums: Dataset, tmp_path: Path) -> None:
    folder = folder_of(pendulums)
    manifest = Manifest.read(folder / "dataset.json")
    assert manifest is not None
    figures = [shard.figures() for shard in pendulums.shards]
    assert manifest.text(figures) == (folder / "dataset.json").read_text()
    assert Manifest.read(tmp_path / "dataset.json") is None


_HUGE = "9" * 5000  # more digits than Python reads


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "Expecting value"),
        ("[]", "it is not of format 2"),
        ("3", "it is not of format 2"),
        ("[" * 100_000, "it is nested too deeply"),
        ('{"format": ' + _HUGE + "}", "Exceeds the limit"),
        ('{"format": 2}', "'recipe'"),
        ("\x00\x80", "."),
    ],
)
def test_a_text_of_something_else_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "dataset.json"
    path.write_text(text, "latin-1")
    with pytest.raises(ValueError, match=message) as caught:
        load(tmp_path)
    assert str(caught.value).startswith(f"{path} is damaged or no list of a dataset's files (")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 1}, "it is not of format 2"),
        ({"format": [2]}, "it is not of format 2"),
        ({"recipe": {}}, "its recipe is not of format 2 or 1"),
        ({"recipe": [[]]}, "its recipe is not of format 2 or 1"),
        ({"seeds": 3}, "not iterable"),
        ({"seeds": [[0, 3], [2, 5]]}, "its seeds do not increase"),
        ({"seeds": [[5, 3]]}, "expected increasing ones"),
        ({"seeds": [[0, 2**40]]}, "expected increasing ones"),
        ({"files": {"a": 1}}, "a file is 'a'"),
        ({"files": [3]}, "a file is 3"),
        ({"files": None}, "not iterable"),
        ({"name": "../x"}, r"a file is named '\.\./x'; expected seeds-0000000000-0000000064"),
        ({"name": "/etc/passwd"}, "a file is named '/etc/passwd'"),
        ({"name": None}, "a file is named None"),
        ({"name": "seeds-0000000001-0000000064.parquet"}, "a file is named 'seeds-0000000001"),
        ({"rows": "many"}, "expected a whole number"),
        ({"bytes": 1.5}, "expected a whole number"),
        ({"sha256": "0"}, "SHA-256 '0'"),
        ({"sha256": 0}, "expected a text"),
    ],
)
def test_a_forged_manifest_is_refused(
    changes: dict[str, Any], message: str, pendulums: Dataset, tmp_path: Path
) -> None:
    content = _content(pendulums)
    for name, value in changes.items():
        (content if name in content else content["files"][0])[name] = value
    folder = copy(folder_of(pendulums), tmp_path / "forged")
    (folder / "dataset.json").write_text(json.dumps(content))
    for allow_gaps in (False, True):
        with pytest.raises(ValueError, match=message) as caught:
            load(folder, allow_gaps=allow_gaps)
        assert str(caught.value).startswith(f"{folder / 'dataset.json'} is damaged or no list")
        assert "\n" not in str(caught.value)


def test_a_huge_manifest_is_refused_before_it_is_read(
    pendulums: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.episodes.manifest._MOST_BYTES", 100)
    with pytest.raises(ValueError, match="it has more than 100 bytes"):
        load(folder_of(pendulums))


def test_a_changed_byte_is_refused_or_changes_nothing_that_is_loaded(
    pendulums: Dataset, tmp_path: Path
) -> None:
    folder = copy(folder_of(pendulums), tmp_path / "changed")
    path, draws, refused = folder / "dataset.json", random.Random(0), 0
    content = path.read_bytes()
    for _ in range(200):
        changed = bytearray(content)
        changed[draws.randrange(len(content))] ^= 1 << draws.randrange(8)
        path.write_bytes(changed)
        try:
            found = load(folder).seeds
        except ValueError:
            refused += 1
            continue
        assert found == pendulums.seeds
    assert refused > 50


def test_a_name_gives_the_seeds_and_nothing_else_does() -> None:
    assert file_name(range(3, 7)) == "seeds-0000000003-0000000007.parquet"
    assert named_seeds("seeds-0000000003-0000000007.parquet") == range(3, 7)
    for name in (
        "seeds-0000000007-0000000003.parquet",
        "seeds-3-7.parquet",
        "../seeds-0000000003-0000000007.parquet",
        "seeds-0000000003-0000000007.parquet.exe",
    ):
        assert named_seeds(name) is None


def test_ranges_are_united_and_subtracted_as_sets_are() -> None:
    draws = random.Random(0)
    for _ in range(300):
        one, other = (
            [range(a, a + draws.randrange(1, 6)) for a in draws.sample(range(40), 4)]
            for _ in range(2)
        )
        ours, theirs = united(one), united(other)
        assert {s for r in ours for s in r} == {s for r in one for s in r}
        assert all(a.stop < b.start for a, b in itertools.pairwise(ours))
        found = without(ours, theirs)
        assert [s for r in found for s in r] == sorted(
            {s for r in one for s in r} - {s for r in other for s in r}
        )


def test_a_file_is_named_by_its_seeds(pendulums: Dataset) -> None:
    manifest = Manifest.read(folder_of(pendulums) / "dataset.json")
    assert manifest is not None
    moved = dataclasses.replace(manifest.files[0], seeds=range(5, 9))
    assert moved.name == "seeds-0000000005-0000000009.parquet"
