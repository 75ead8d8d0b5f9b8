"""Files of episodes: their bytes, and what is refused of those that anyone may have changed."""

import dataclasses
import itertools
import json
import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.episodes.episode import Kept
from limberjack.episodes.parquet import Shard, columns_of, encode, episode_of, join
from limberjack.episodes.recipe import GROUP_NBYTES, Column
from tests.programs import run

from .collected import ARM, EVERYTHING, PENDULUM, assert_equal, made

pa = pytest.importorskip("pyarrow", reason="needs the extra 'data'")
pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'data'")


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of three episodes."""
    recipe, episodes = made(PENDULUM, range(3, 6), Kept(states=True))
    return _written(tmp_path_factory.mktemp("file") / "file.parquet", encode(recipe, episodes))


@pytest.mark.parametrize("where", [PENDULUM, ARM])
@pytest.mark.parametrize("kept", [Kept(), EVERYTHING])
def test_episodes_are_read_as_they_were_written(
    where: tuple[str, str, float], kept: Kept, tmp_path: Path
) -> None:
    recipe, episodes = made(where, range(64, 67), kept)
    shard = Shard(_written(tmp_path / "file.parquet", encode(recipe, episodes)))
    assert (shard.recipe, shard.seeds) == (recipe, range(64, 67))
    assert shard.lengths == [episode.length for episode in episodes]
    for one, other in zip(episodes, shard.episodes(), strict=True):
        assert_equal(one, other)


def test_writing_and_reading_import_no_pandas(tmp_path: Path) -> None:
    pytest.importorskip("pandas", reason="tests that pandas, if installed, is not imported")
    run(
        """
        import pathlib, sys
        from limberjack.episodes.episode import Kept
        from limberjack.episodes.parquet import Shard, encode
        from tests.episodes.collected import ARM, EVERYTHING, assert_equal, made

        recipe, (episode,) = made(ARM, range(3, 4), EVERYTHING)
        path = pathlib.Path(sys.argv[1])
        path.write_bytes(encode(recipe, [episode]))
        (found,) = Shard(path).episodes()
        assert_equal(found, episode)
        assert "pyarrow" in sys.modules
        assert "pandas" not in sys.modules
        """,
        str(tmp_path / "file.parquet"),
        path=Path(__file__).parents[2],
    )


def test_equal_episodes_give_equal_bytes_also_in_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for nbytes in (1, 20_000, 2**18):  # an episode takes 8,000 bytes before compression
        monkeypatch.setattr("limberjack.episodes.parquet.GROUP_NBYTES", nbytes)
        recipe, episodes = made(ARM, range(8))
        whole = encode(recipe, episodes)
        assert encode(*made(ARM, range(8))) == whole
        for cuts in ([1, 8], [2, 3, 8], [5, 8]):
            parts = [
                Shard(_written(tmp_path / f"{first}-{end}", encode(recipe, episodes[first:end])))
                for first, end in itertools.pairwise([0, *cuts])
            ]
            join(recipe, range(8), parts, tmp_path / "joined")
            assert (tmp_path / "joined").read_bytes() == whole
            join(recipe, range(7), parts, tmp_path / "less")
            assert (tmp_path / "less").read_bytes() == encode(recipe, episodes[:7])
    overlapping = [parts[0], Shard(_written(tmp_path / "more", encode(recipe, episodes[3:])))]
    join(recipe, range(8), overlapping, tmp_path / "joined")
    assert (tmp_path / "joined").read_bytes() == whole


def test_parts_that_lack_an_episode_or_are_of_another_dataset_are_not_joined(
    tmp_path: Path,
) -> None:
    recipe, episodes = made(PENDULUM, range(4))
    parts = [Shard(_written(tmp_path / f"{k}", encode(recipe, [episodes[k]]))) for k in (0, 1, 3)]
    for some in (parts, parts[:2], [*parts[:2], parts[1], parts[2]]):
        with pytest.raises(ValueError, match="no part has the episode of seed 2: collect it"):
            join(recipe, range(4), some, tmp_path / "joined")
    other = dataclasses.replace(recipe, facts={**recipe.facts, "policy": "zero"})
    with pytest.raises(ValueError, match=r"0 belongs to another dataset .* policy is 'random' and"):
        join(other, range(2), parts, tmp_path / "joined")


def test_short_episodes_share_row_groups_so_that_a_footer_stays_small(tmp_path: Path) -> None:
    recipe, episodes = made(PENDULUM, range(700))
    path = _written(tmp_path / "file.parquet", encode(recipe, episodes))
    metadata = pq.read_metadata(path)
    row = sum(column.nbytes for column in recipe.columns)
    whole = -(-GROUP_NBYTES // (11 * row))  # episodes of a complete row group
    assert [metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)] == [
        11 * whole, 11 * whole, 11 * (700 - 2 * whole),
    ]  # fmt: skip
    assert metadata.serialized_size < 0.05 * path.stat().st_size
    shard = Shard(path)
    assert shard.lengths == [10] * 700
    with shard.opened() as read:
        for seed in (699, 0, whole - 1, whole):
            assert_equal(read(seed), episodes[seed])


def test_a_file_without_lengths_has_an_episode_in_each_row_group(
    pendulum: Path, tmp_path: Path
) -> None:
    copy = _rewritten(pendulum, tmp_path / "copy.parquet", lengths=None, groups=[11, 11, 11])
    assert Shard(copy).lengths == [10, 10, 10]
    for one, other in zip(Shard(pendulum).episodes(), Shard(copy).episodes(), strict=True):
        assert_equal(one, other)


@pytest.mark.parametrize("where", [PENDULUM, ARM])
@pytest.mark.parametrize("kept", [Kept(), EVERYTHING])
def test_the_columns_of_an_episode_give_the_episode(
    where: tuple[str, str, float], kept: Kept
) -> None:
    recipe, (episode,) = made(where, range(7, 8), kept)
    values = columns_of(episode, recipe)
    assert list(values) == [column.name for column in recipe.columns]
    assert_equal(episode_of(values, 7, recipe), episode)


@pytest.mark.parametrize(("row", "value"), [(-1, False), (3, True)])
def test_an_episode_that_ends_elsewhere_is_refused(row: int, value: bool) -> None:
    recipe, (episode,) = made(PENDULUM, range(1))
    values = columns_of(episode, recipe)
    truncated = np.array(values["truncated"])
    truncated[row] = value
    with pytest.raises(ValueError, match="seed 0 does not end with its last step"):
        episode_of({**values, "truncated": truncated}, 0, recipe)


@pytest.mark.parametrize("name", ["seed", "step", "time", "is_first", "is_last"])
def test_rows_of_another_place_are_refused(name: str) -> None:
    recipe, (episode,) = made(PENDULUM, range(1))
    values = columns_of(episode, recipe)
    wrong = np.array(values[name])
    wrong[4] = 1 - wrong[4]
    with pytest.raises(ValueError, match=f"the episode of seed 0 has rows of {name} "):
        episode_of({**values, name: wrong}, 0, recipe)


@pytest.mark.parametrize("kept", [Kept(), EVERYTHING])
@pytest.mark.parametrize("where", [PENDULUM, ARM, ("humanoid", "walk", 0.25)])
def test_a_file_takes_no_more_bytes_than_its_recipe_says(
    where: tuple[str, str, float], kept: Kept
) -> None:
    recipe, episodes = made(where, range(64), kept)
    for count in (1, 2, 64):
        assert len(encode(recipe, episodes[:count])) <= recipe.most_nbytes(count, files=1)
    assert recipe.most_nbytes(64, files=1) < 4 * len(encode(recipe, episodes))


def test_other_programs_find_a_row_per_step(pendulum: Path) -> None:
    table = pq.read_table(pendulum)
    assert table.num_rows == 3 * 11
    assert table.column("seed").to_pylist() == [3] * 11 + [4] * 11 + [5] * 11
    assert table.column("step").to_pylist() == [*range(11)] * 3
    assert table.column("time").to_pylist() == [step * 0.02 for step in range(11)] * 3
    assert table.column("is_first").to_pylist() == [step == 0 for step in range(11)] * 3
    assert b"limberjack" in table.schema.metadata


def test_the_last_row_of_an_episode_has_an_observation_and_nulls(pendulum: Path) -> None:
    table = pq.read_table(pendulum)
    last = [step == 10 for step in range(11)] * 3
    assert table.column("is_last").to_pylist() == last
    of_steps = {"action", "reward", "terminated", "truncated", "success", "diverged"}
    for name, column in zip(table.column_names, table.columns, strict=True):
        expected = last if name in of_steps else [False] * 33
        assert column.is_null().to_pylist() == expected, name
    truncated = table.column("truncated").to_pylist()
    assert truncated == [*[False] * 9, True, None] * 3


def test_the_footer_has_the_figures_of_the_episodes(pendulum: Path) -> None:
    shard = Shard(pendulum)
    episodes = list(shard.episodes())
    figures = shard.figures()
    assert figures.returns == [episode.total for episode in episodes]
    actions = np.concatenate([episode.actions for episode in episodes])
    assert figures.statistics()["action"]["max"] == actions.max(axis=0).tolist()


def test_the_footer_names_no_path_host_or_date(pendulum: Path) -> None:
    content = json.loads(pq.read_schema(pendulum).metadata[b"limberjack"])
    assert set(content) == {
        "action_repeat", "columns", "control_timestep", "domain", "file_mb", "fingerprint",
        "flat", "float32", "format", "policy", "policy_sha256", "seeds", "states", "task",
        "time_limit", "versions",
    }  # fmt: skip
    assert set(content["versions"]) == {"limberjack", "mujoco", "numpy", "pyarrow", "python"}


def test_a_file_that_is_cut_short_anywhere_is_refused(pendulum: Path, tmp_path: Path) -> None:
    content = pendulum.read_bytes()
    lengths = random.Random(1).sample(range(len(content)), 100)
    for length in (0, 1, len(content) - 1, *lengths):
        path = _written(tmp_path / "cut.parquet", content[:length])
        with pytest.raises(ValueError, match=r"cut.parquet is damaged or no file of a dataset"):
            Shard(path)


def test_a_changed_byte_is_refused_or_changes_nothing(pendulum: Path, tmp_path: Path) -> None:
    content, draws = pendulum.read_bytes(), random.Random(0)
    expected = list(Shard(pendulum).episodes())
    refused = 0
    for _ in range(600):
        changed = bytearray(content)
        changed[draws.randrange(len(content))] ^= 1 << draws.randrange(8)
        path = _written(tmp_path / "changed.parquet", bytes(changed))
        try:
            found = list(Shard(path).episodes())
        except ValueError:
            refused += 1
            continue
        for one, other in zip(expected, found, strict=True):
            assert_equal(one, dataclasses.replace(other, seed=one.seed))
    assert refused > 400


def _rewritten(source: Path, path: Path, **changes: Any) -> Path:
    """A file with other columns, or another recipe, that is a valid Parquet file."""
    table = pq.read_table(source)
    metadata = {b"limberjack": changes.pop("recipe", table.schema.metadata[b"limberjack"])}
    lengths = changes.pop("lengths", b"[[10,3]]")
    if lengths is not None:
        metadata[b"limberjack_lengths"] = lengths
    groups = changes.pop("groups", [33])
    for name, values in changes.items():
        field = table.schema.field(name)
        values = values.cast(field.type)
        table = table.set_column(table.schema.get_field_index(name), field, values)
    table = table.replace_schema_metadata(metadata)
    with pq.ParquetWriter(path, table.schema) as writer:
        begin = 0
        for size in groups:
            writer.write_table(table.slice(begin, size), row_group_size=size)
            begin += size
    return path


def test_a_rewritten_file_is_read_if_nothing_is_forged(pendulum: Path, tmp_path: Path) -> None:
    shard = Shard(_rewritten(pendulum, tmp_path / "copy.parquet"))
    for one, other in zip(Shard(pendulum).episodes(), shard.episodes(), strict=True):
        assert_equal(one, other)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"recipe": b"{}"}, "not of format 2 or 1"),
        ({"recipe": b"\x80\x04."}, "damaged or no file"),
        ({"groups": [22, 11], "lengths": None}, "it has 2 episodes"),
        ({"groups": [11, 21, 1], "lengths": None}, "steps"),
        (
            {"groups": [10, 12, 11], "lengths": None},
            "'action' is null elsewhere than in the last row",
        ),
        ({"groups": [10, 12, 11]}, "its row groups are not of whole episodes"),
        ({"lengths": b"[[10,2]]"}, "its lengths are not those of 3 episodes"),
        ({"lengths": b"[[11,3]]"}, "its row groups are not of whole episodes"),
        ({"lengths": b"[[-10,3]]"}, "its lengths are damaged: expected a whole number"),
        ({"lengths": b"[[10,3],[0,0]]"}, "its lengths are no positive numbers"),
        ({"lengths": b"[[10,1],[12,1],[8,1]]"}, "'action' is null elsewhere than in the last row"),
        *(
            ({"lengths": text}, "its lengths are damaged")
            for text in (b"", b"{}x", b"3", b"[[10]]", b"[" * 100_000)
        ),
        ({"action": pa.array([[0.0]] * 33)}, "'action' is null elsewhere"),
        ({"action": pa.array([*[[0.0]] * 9, [], None] * 3)}, "'action' has no 1 numbers in a row"),
        ({"reward": pa.array([*[0.0] * 8, None, 0.0, None] * 3)}, "'reward' is null elsewhere"),
        ({"reward": pa.array([*[0.0] * 9, None, 0.0] * 3)}, "'reward' is null elsewhere"),
        ({"seed": pa.array(np.zeros(33, int))}, "has rows of seed"),
    ],
)
def test_a_forged_file_is_refused(
    changes: dict[str, Any], message: str, pendulum: Path, tmp_path: Path
) -> None:
    path = _rewritten(pendulum, tmp_path / "forged.parquet", **changes)
    with pytest.raises(ValueError, match=message) as caught:
        list(Shard(path).episodes())
    assert str(path) in str(caught.value)


def test_columns_of_another_recipe_are_refused(pendulum: Path, tmp_path: Path) -> None:
    recipe, _ = made(ARM, range(3, 6))
    text = recipe.text(range(3, 6)).encode()
    with pytest.raises(ValueError, match="its columns are not those of its recipe"):
        Shard(_rewritten(pendulum, tmp_path / "forged.parquet", recipe=text))


def test_a_model_field_of_another_size_is_refused(tmp_path: Path) -> None:
    recipe, episodes = made(ARM, range(1))
    content = encode(recipe, episodes)
    source = _written(tmp_path / "arm.parquet", content)
    rows = [[0.0] * 36, [], [0.0], [], [], []]
    kind = pq.read_schema(source).field("field/body_pos").type
    forged = _rewritten(
        source,
        tmp_path / "forged.parquet",
        groups=[6],
        lengths=b"[[5,1]]",
        **{"field/body_pos": pa.array(rows, kind)},
    )
    with pytest.raises(ValueError, match=r"'field/body_pos' has no 36 numbers in a row"):
        list(Shard(forged).episodes())


def test_an_episode_that_would_fill_the_memory_is_refused_before_it_is_read(
    pendulum: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.episodes.parquet.MOST_NBYTES", 1000)
    with pytest.raises(ValueError, match="an episode takes more than 1,000 bytes"):
        Shard(pendulum)


def test_a_pickle_and_a_missing_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Shard(tmp_path / "missing.parquet")
    with pytest.raises(ValueError, match="damaged or no file of a dataset"):
        Shard(_written(tmp_path / "pickle.parquet", b"\x80\x04cos\nsystem\n."))


def test_an_open_file_reads_single_episodes(pendulum: Path, tmp_path: Path) -> None:
    expected = list(Shard(pendulum).episodes())
    copy = Path(shutil.copy(pendulum, tmp_path / "copy.parquet"))
    with Shard(copy).opened() as read:
        assert_equal(read(5), expected[2])
        assert_equal(read(3), expected[0])


@pytest.mark.parametrize("text", [b"", b"{}", b"[" * 100_000, b'{"returns": [1], "columns": {}}'])
def test_forged_figures_are_refused(text: bytes, pendulum: Path, tmp_path: Path) -> None:
    table = pq.read_table(pendulum)
    metadata = {**table.schema.metadata, b"limberjack_figures": text}
    path = tmp_path / "forged.parquet"
    pq.write_table(table.replace_schema_metadata(metadata), path, row_group_size=11)
    with pytest.raises(ValueError, match=r"forged.parquet is damaged .*its figures are damaged"):
        Shard(path).figures()


@pytest.mark.parametrize("shape", [(0,), (2, 0)])
def test_an_observation_without_numbers_is_kept(shape: tuple[int, ...], tmp_path: Path) -> None:
    recipe, episodes = made(PENDULUM, range(3), Kept())
    place = [column.name for column in recipe.columns].index("observation/velocity")
    columns = list(recipe.columns)
    columns.insert(place, Column("observation/nothing", "float64", shape))
    recipe = dataclasses.replace(recipe, columns=tuple(columns))
    changed = [
        dataclasses.replace(
            one,
            observations={
                "orientation": one.observations["orientation"],
                "nothing": np.zeros((one.length + 1, *shape)),
                "velocity": one.observations["velocity"],
            },
        )
        for one in episodes
    ]
    shard = Shard(_written(tmp_path / "file.parquet", encode(recipe, changed)))
    for one, other in zip(changed, shard.episodes(), strict=True):
        assert_equal(one, other)
