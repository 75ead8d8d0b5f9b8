"""Recipes as texts in footers, some of them forged."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.episodes.episode import Kept
from limberjack.episodes.recipe import Column, Recipe, recipe_of
from limberjack.rl import control
from limberjack.rl.pixels import Pixels
from limberjack.suite import ALL_TASKS, pendulum
from tests.rl.odd_environments import Repeating

from .collected import ARM, EVERYTHING, PENDULUM, made

_RECIPE, _ = made(PENDULUM, range(1))


@pytest.mark.parametrize("kept", [Kept(), EVERYTHING])
def test_a_recipe_is_read_as_it_was_written(kept: Kept) -> None:
    recipe, _ = made(ARM, range(1), kept)
    assert Recipe.parse(recipe.text(range(64, 70))) == (recipe, range(64, 70))


def test_a_task_of_every_domain_has_columns_that_can_be_read_again() -> None:
    first = dict(reversed(ALL_TASKS))
    for domain, task in first.items():
        environment = suite.load(domain, task, {"random": 0, "time_limit": 0.1})
        for kept in (Kept(), EVERYTHING):
            recipe = recipe_of(_RECIPE.facts, environment, kept)
            assert Recipe.parse(recipe.text(range(1)))[0] == recipe, (domain, task)
            assert all(column.size for column in recipe.columns), (domain, task)
        environment.close()


def test_of_a_saved_model_only_the_files_name_is_kept() -> None:
    environment = suite.load(*PENDULUM[:2])
    facts = _RECIPE.facts.copy()
    facts["policy"] = "sb3:/home/me/models/walk.zip"
    assert recipe_of(facts, environment, Kept()).facts["policy"] == "sb3:walk.zip"


def test_float32_is_for_observations_only() -> None:
    recipe, _ = made(ARM, range(1), Kept(states=True, float32=True))
    types = {column.name: column.dtype for column in recipe.columns}
    assert types["observation/arm_pos"] == "float32"
    assert [types[n] for n in ("action", "reward", "state", "field/body_pos")] == ["float64"] * 4


def test_the_size_of_an_episode_counts_every_row_and_each_field_once() -> None:
    recipe, (episode,) = made(ARM, range(1), Kept(states=True))
    assert episode.states is not None
    arrays = [*episode.observations.values(), episode.states]
    rows = sum(array.nbytes for array in arrays)
    of_actions = episode.actions.nbytes // 5 * 6
    fields = sum(array.nbytes for array in episode.fields.values())
    rest = 6 * (8 + 8 + 8 + 8 + 6)  # seed, step, time and reward; six flags
    assert recipe.episode_nbytes == rows + of_actions + fields + rest


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 3}, "not of format 2 or 1"),
        ({"format": True}, "not of format 2 or 1"),
        ({"format": [2]}, "not of format 2 or 1"),
        ({"format": 1}, "its columns .'step', 'time', 'is_first', 'is_last'. are"),
        ({"file_mb": 0}, "file_mb is 0; expected a positive number"),
        ({"file_mb": float("nan")}, "file_mb is nan; expected a positive number"),
        ({"file_mb": 1e300}, "file_mb is 1e"),
        ({"file_mb": "all"}, "file_mb is 'all'"),
        ({"seeds": [0, 2**32]}, "expected some within one block of"),
        ({"file_mb": 1e-9, "seeds": [0, 2]}, "expected some within one block of 1$"),
        ({"seeds": [2, 2]}, "expected increasing ones"),
        ({"seeds": [-1, 2]}, "expected a whole number from 0 on"),
        ({"seeds": "all"}, "expected a list"),
        ({"seeds": [False, True]}, "expected a whole number"),
        ({"columns": 3}, "damaged"),
        ({"columns": [["seed", "int64", []]]}, "its columns .'action', .* are missing"),
        ({"columns": [["seed", "object", []]]}, "a column is .*'object'"),
        ({"columns": [["seed", "int64", [-1]]]}, "damaged: a column is .*expected a whole number"),
        ({"columns": [["seed", "int64", [2**30]]]}, "a column is .*1073741824"),
        ({"columns": ["seed"]}, "damaged: a column is .*expected a list"),
        ({"flat": 1}, "damaged: flat is 1; expected true or false"),
        ({"states": True}, "its columns .'state'. are missing"),
        ({"time_limit": -1.0}, "its time_limit is -1.0"),
        ({"time_limit": float("nan")}, "its time_limit is nan"),
        ({"time_limit": 1e300}, "its time_limit is"),
        ({"control_timestep": 0}, "its control_timestep|its time_limit"),
        ({"versions": {"mujoco": 4}}, "its versions is .*; expected a text"),
        ({"domain": ["pendulum"]}, "its domain is"),
        ({"more": 1}, "its facts are"),
        ({"world": "easy"}, "its world is 'easy'"),
        ({"world": {"pixels": {}}}, r"its world has \['pixels'\]; expected some of"),
    ],
)
def test_a_forged_recipe_is_refused(changes: dict[str, Any], message: str) -> None:
    content = json.loads(_RECIPE.text(range(3)))
    with pytest.raises(ValueError, match=message):
        Recipe.parse(json.dumps({**content, **changes}))


@pytest.mark.parametrize("column", [
    ["seed", "int64", []],
    ["unknown", "int64", []],
    ["observation/x", "str", []],
    ["start", "int64", []],
    ["success", "bool", [2]],
])  # fmt: skip
def test_a_further_column_must_be_one_of_those_that_exist(column: list[Any]) -> None:
    content = json.loads(_RECIPE.text(range(3)))
    content["columns"] = [c for c in content["columns"] if c[0] != "success"] + [column]
    with pytest.raises(ValueError, match="column"):
        Recipe.parse(json.dumps(content))


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"3", b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_json_object_is_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        Recipe.parse(text)


def test_a_file_has_as_many_seeds_as_full_episodes_have_room() -> None:
    recipe, _ = made(("humanoid", "walk", 0.25), range(1))
    assert recipe.file_mb == 100.0
    assert recipe.block == int(100e6 // recipe.most_nbytes(1, files=0))
    assert dataclasses.replace(recipe, file_mb=1e-6).block == 1
    tiny, _ = made(("pendulum", "swingup", 0.02), range(1))
    assert dataclasses.replace(tiny, file_mb=1e6).block == 2**15 - 1


def test_columns_of_format_1_are_those_without_places() -> None:
    old = dataclasses.replace(_RECIPE, file_mb=None)
    environment = suite.load(*PENDULUM[:2], {"random": 0, "time_limit": PENDULUM[2]})
    names = [column.name for column in old.here(environment).columns]
    assert names[:2] == ["seed", "observation/orientation"]
    assert [c.name for c in _RECIPE.here(environment).columns][1] == "step"
    assert (old.format, old.block) == (1, 64)


def test_a_difference_names_the_entry_and_both_values() -> None:
    other, _ = made(PENDULUM, range(1), policy="zero")
    assert _RECIPE.difference(_RECIPE) is None
    assert _RECIPE.difference(other) == "policy is 'random' and 'zero'"
    flat = Recipe(_RECIPE.facts, Kept(flat=True), _RECIPE.columns)
    assert _RECIPE.difference(flat) == "flat is False and True"


def test_of_versions_only_the_one_that_differs_is_named() -> None:
    versions = {**_RECIPE.facts["versions"], "mujoco": "4.7.0"}
    other = dataclasses.replace(_RECIPE, facts={**_RECIPE.facts, "versions": versions})
    here = _RECIPE.facts["versions"]["mujoco"]
    assert _RECIPE.difference(other) == f"versions.mujoco is {here!r} and '4.7.0'"


def test_a_columns_bytes_are_those_of_its_numbers() -> None:
    assert Column("observation/x", "float32", (2, 3)).nbytes == 24
    assert Column("start", "str").nbytes == 0


@pytest.mark.parametrize("kept", [Kept(), Kept(pixels=Pixels(height=480, width=640))])
def test_an_episode_that_no_reader_accepts_is_refused_with_its_size(kept: Kept) -> None:
    environment = suite.load(*PENDULUM[:2])
    row = recipe_of(_RECIPE.facts, environment, kept).row_nbytes

    def of(steps: int) -> Recipe:
        facts = _RECIPE.facts.copy()
        facts["time_limit"] = steps * facts["control_timestep"]
        return recipe_of(facts, environment, kept)

    most = (2**30 - 2**18) // row - 1
    assert of(most).step_limit == most
    with pytest.raises(
        ValueError, match=f"an episode of {most + 1:,} steps may take 1.07 GB"
    ) as no:
        of(most + 1)
    limit = f"{most * _RECIPE.facts['control_timestep']:g}"
    assert f"give a time_limit of at most {limit} s" in str(no.value)
    shown = "921,600 of them for pictures of 480 by 640"
    assert (shown in str(no.value)) is (kept.pixels is not None)


class _OwnReward(pendulum.SwingUp):
    """Says of no step whether it reached the goal, which its class has."""

    def get_reward(self, physics: Any) -> Any:
        return 1.0 * physics.pole_vertical()


def test_only_episodes_that_say_so_have_a_column_of_success() -> None:
    def has(environment: Any) -> bool:
        columns = recipe_of(_RECIPE.facts, environment, Kept()).columns
        return "success" in [column.name for column in columns]

    environment = suite.load(*PENDULUM[:2])
    assert has(environment)
    assert not has(Repeating(environment))
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    assert not has(control.Environment(physics, _OwnReward(random=0), control_timestep=0.02))


class _Signs(pendulum.SwingUp):
    def get_observation(self, physics: Any) -> Any:
        return {"sign": np.sign(physics.data.qvel).astype(np.int16)}


def test_an_observation_of_a_dtype_that_is_not_kept_is_refused_before_anything_is_played() -> None:
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    environment = control.Environment(physics, _Signs(random=0), control_timestep=0.02)
    with pytest.raises(ValueError, match=r"observation/sign has type int16.*expected one of bool"):
        recipe_of(_RECIPE.facts, environment, Kept())


class _Blind(pendulum.SwingUp):
    def get_observation(self, physics: Any) -> Any:
        return {}


def test_no_observations_cannot_be_joined() -> None:
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    environment = control.Environment(physics, _Blind(random=0), control_timestep=0.02)
    names = {column.name for column in recipe_of(_RECIPE.facts, environment, Kept()).columns}
    assert not any(name.startswith("observation/") for name in names)
    with pytest.raises(ValueError, match="observes nothing that could be joined: leave out flat"):
        recipe_of(_RECIPE.facts, environment, Kept(flat=True))
