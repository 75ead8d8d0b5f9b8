"""`mlp:PATH` and `pretrained`, played as any other policy."""

import collections
import dataclasses
import logging
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import data, policies, suite, viewer
from limberjack.episodes.playing import batch_for, play
from limberjack.evaluation import evaluate
from limberjack.policies import PolicyError, mlp, networks
from limberjack.rl.control import Environment
from limberjack.rl.randomize import scale, shift
from limberjack.suite import base
from limberjack.suite.wrappers import action_scale, pixels
from limberjack.viewer.session import Session
from limberjack.workers.shipping import ship, unpack
from tests.episodes.collected import whole_hashes
from tests.policies.network_files import bundle, card_of, drawn, write
from tests.rollouts import run_episode


def _load(domain: str = "walker", task: str = "walk", **kwargs: Any) -> Environment:
    return suite.load(domain, task, {"random": 7, "time_limit": 0.5}, kwargs)


def _totals(name: str, domain: str, task: str, seeds: range) -> list[float]:
    """Returns of single environments in which the policy acts."""
    found = []
    for seed in seeds:
        environment = suite.load(domain, task, {"random": seed, "time_limit": 0.5})
        found.append(run_episode(environment, policies.find(name, environment), seed).total)
    return found


def test_a_network_repeats_each_action_as_its_card_says(tmp_path: Path) -> None:
    name = write(tmp_path / "p", action_repeat=3)
    policy = mlp.load(tmp_path / "p")
    environment = _load()
    act = policies.find(name, environment).begin_alone(environment, 7)
    time_step = environment.reset()
    held = np.zeros(6)
    for step in range(8):
        action = act(time_step.observation)
        if step % 3 == 0:
            held = policy.act_batch({n: v[None] for n, v in time_step.observation.items()})[0]
        # A product of one row rounds differently than one of 64.
        np.testing.assert_allclose(action, held, atol=1e-5)
        time_step = environment.step(action)


def test_a_network_in_memory_is_played_as_its_file_is(tmp_path: Path) -> None:
    name = write(tmp_path / "p", action_repeat=3)
    how = {"seeds": range(3), "time_limit": 0.5}
    of_file, of_memory = (
        evaluate("walker", "walk", policy, **how) for policy in (name, mlp.load(tmp_path / "p"))
    )
    assert of_memory.facts["action_repeat"] == 3
    totals = [[one.total for one in each.scores[each.policy]] for each in (of_file, of_memory)]
    assert totals[0] == totals[1]


def test_networks_in_memory_are_told_apart_and_checked(tmp_path: Path) -> None:
    write(tmp_path / "p", action_repeat=3)
    policy, environment = mlp.load(tmp_path / "p"), _load()
    other = mlp.Mlp([(weight, bias + 1) for weight, bias in policy.layers], policy.card)
    found = [policies.find(one, environment).sha256 for one in (policy, policy, other)]
    assert None not in found
    assert found[0] == found[1] != found[2]
    with pytest.raises(PolicyError, match="takes an observation 'orientations'"):
        policies.find(policy, suite.load("cheetah", "run"))
    late = policies.find(policy)
    assert late.name == "limberjack.policies.mlp:Mlp"
    time_step = environment.reset()
    act, expected = (one.begin_alone(environment, 7) for one in (late, policies.find(policy)))
    np.testing.assert_array_equal(act(time_step.observation), expected(time_step.observation))


def test_an_environment_that_repeats_actions_is_asked_for_one_at_each_step(tmp_path: Path) -> None:
    name = write(tmp_path / "p", action_repeat=3)
    totals = []
    for own in (1, 3):
        environment = _load(action_repeat=own)
        policy = policies.find(name, environment)
        assert policy.action_repeat == 3
        totals.append(run_episode(environment, policy, 7).total)
    # The environment adds the rewards of an action first, in another order.
    np.testing.assert_allclose(totals[0], totals[1], rtol=1e-12)
    other = _load(action_repeat=2)
    with pytest.raises(PolicyError, match="has action_repeat=2; expected 3, or 1"):
        policies.find(name, other).begin_alone(other, 0)


@pytest.mark.parametrize("given", [True, False])
def test_a_network_is_found_with_and_without_an_environment(given: bool, tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    environment = _load()
    policy = policies.find(name, environment if given else None)
    assert policy.name == name
    assert policy.plays_alone != given
    (expected,) = _totals(name, "walker", "walk", range(7, 8))
    assert run_episode(environment, policy, 7).total == expected


def test_what_was_found_for_no_environment_fits_each_one_that_it_plays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path, ("walker", "walk"), ("cheetah", "run"))
    policy = policies.find("pretrained")
    for domain, task in (("walker", "walk"), ("cheetah", "run"), ("walker", "walk")):
        environment = _load(domain, task)
        (expected,) = _totals("pretrained", domain, task, range(7, 8))
        assert run_episode(environment, policy, 7).total == expected
    reacher = _load("reacher", "easy")
    with pytest.raises(PolicyError, match="reacher easy has none"):
        policy.begin_alone(reacher, 0)


def test_a_network_found_for_one_task_is_refused_in_another(tmp_path: Path) -> None:
    policy = policies.find(write(tmp_path / "p"), _load())
    cheetah = _load("cheetah", "run")
    with pytest.raises(PolicyError, match="does not fit: it takes an observation 'orientations'"):
        policy.begin_alone(cheetah, 0)


_OTHER = [
    (
        {"layout": (("orientations", (14,)), ("height", ()), ("speed", (9,)))},
        "it takes an observation 'speed', and the task has orientations, height, velocity",
    ),
    (
        {"layout": (("orientations", (14,)), ("height", (10,)))},
        r"it takes 'height' of shape \(10,\); the task's has \(\)",
    ),
    (
        {"layout": (("orientations", (15,)), ("velocity", (9,)))},
        r"it takes 'orientations' of shape \(15,\); the task's has \(14,\)",
    ),
    (
        {"layout": (("orientations", (14,)), ("velocity", (9,)))},
        "the task has an observation 'height', and it takes orientations, velocity",
    ),
    ({"layout": (("observations", (23,)),)}, "it takes 23 numbers as observation; .* has 24"),
    ({"low": (-1.0,) * 5, "high": (1.0,) * 5}, r"its actions have shape \(5,\); the task's .*6"),
    (
        {"low": (-1.0,) * 5 + (-2.0,)},
        "its action 5 reaches from -2 to 1; the task's from -1 to 1",
    ),
    (
        {"high": (1.0,) * 5 + (2.0,)},
        "its action 5 reaches from -1 to 2; the task's from -1 to 1",
    ),
]


@pytest.mark.parametrize(("changes", "message"), _OTHER)
def test_a_network_of_another_form_is_refused_by_name(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    name = write(tmp_path / "p", **changes)
    with pytest.raises(PolicyError, match=f"policy .*p' does not fit: {message}") as caught:
        policies.find(name, _load())
    assert "\n" not in str(caught.value)
    with pytest.raises(PolicyError, match=message):
        policies.find(name).begin_alone(_load(), 0)


def test_bounds_of_a_file_may_be_those_of_the_task_in_float32(tmp_path: Path) -> None:
    low, high = (tuple(np.full(6, bound, np.float32).tolist()) for bound in (-0.1, 0.1))
    assert high[0] > 0.1
    environment = action_scale.Wrapper(_load(), minimum=-0.1, maximum=0.1)
    policies.find(write(tmp_path / "p", low=low, high=high), environment)
    name = write(tmp_path / "p", low=low, high=(*high[:5], 0.1001))
    with pytest.raises(PolicyError, match=r"5 reaches from -0\.1 to 0\.1001; the task's"):
        policies.find(name, environment)


def _without_layout(tmp_path: Path) -> str:
    card = card_of("walker", "walk")
    flat = dataclasses.replace(card, layout=(("observations", (card.num_observations,)),))
    mlp.save(tmp_path / "flat", drawn(24, 16, 6), flat)
    return f"mlp:{tmp_path / 'flat'}"


def test_a_network_of_flat_observations_plays_any_form_of_them(tmp_path: Path) -> None:
    named, flat = write(tmp_path / "p"), _without_layout(tmp_path)
    (expected,) = _totals(named, "walker", "walk", range(7, 8))
    for name in (named, flat):
        for is_flat in (False, True):
            environment = _load(flat_observation=is_flat)
            assert run_episode(environment, policies.find(name, environment), 7).total == expected


class _Named(base.Task):
    """A task whose observations are in the order of no alphabet."""

    def __init__(self, kind: type) -> None:
        super().__init__(random=0)
        self._kind = kind

    def get_observation(self, physics: Any) -> Any:
        return self._kind([("z", physics.velocity() + 1.0), ("a", physics.velocity() - 1.0)])

    def get_reward(self, physics: Any) -> Any:
        return physics.control()[..., 0]


@pytest.mark.parametrize("kind", [dict, collections.OrderedDict])
def test_a_flat_observation_has_the_order_of_the_card_or_is_refused(
    kind: type, tmp_path: Path
) -> None:
    """As in dm_control, a flat observation of a plain dictionary is in the order of the names."""
    physics: Any = suite.load("cartpole", "balance").physics

    def made(is_flat: bool) -> Environment:
        return Environment(physics, _Named(kind), time_limit=0.1, flat_observation=is_flat)

    layer = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros(1)  # acts as the first number
    for name, layout in (
        ("named", networks.layout_of(made(is_flat=False))),
        ("flat", networks.layout_of(made(is_flat=True))),
    ):
        mlp.save(tmp_path / name, [layer], mlp.Card(layout=layout, low=(-1.0,), high=(1.0,)))
    policy = f"mlp:{tmp_path / 'named'}"
    act = policies.find(policy, made(is_flat=False)).begin_alone(made(is_flat=False), 0)
    assert act(made(is_flat=False).reset().observation)[0] > 0.5
    if kind is dict:
        with pytest.raises(PolicyError, match=r"takes z, a in this order, .* has a, z: make"):
            policies.find(policy, made(is_flat=True))
    else:
        act = policies.find(policy, made(is_flat=True)).begin_alone(made(is_flat=True), 0)
        assert act(made(is_flat=True).reset().observation)[0] > 0.5
    for is_flat in (False, True):  # the first number of a flat observation
        policy = policies.find(f"mlp:{tmp_path / 'flat'}", made(is_flat))
        action = policy.begin_alone(made(is_flat), 0)(made(is_flat).reset().observation)
        assert (action[0] < -0.5) == (kind is dict)


def test_a_policy_that_is_found_as_its_episode_begins_repeats_actions_once(tmp_path: Path) -> None:
    name = write(tmp_path / "p", action_repeat=2)
    environment = _load()
    totals = []
    for actor in (policies.find(name), policies.find(name, environment)):
        batch = batch_for(environment, actor, [7])
        (played,) = [one for ended in play(batch, actor, [7], action_repeat=2) for one in ended]
        totals.append(played.total)
    assert totals[0] == totals[1]


def test_bounds_beyond_float32_are_the_widest_of_it(tmp_path: Path) -> None:
    card = mlp.Card(layout=(("x", (1,)),), low=(-1e39,), high=(1e39,))
    mlp.save(tmp_path / "p", [(np.full((1, 1), 3e38), np.zeros(1))], card)
    assert mlp.load(tmp_path / "p").actions([2.0]).tolist() == [np.finfo(np.float32).max]


def test_pictures_beside_the_observations_are_ignored(tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    environment = pixels.Wrapper(_load(), pixels_only=False, render_kwargs={"width": 8})
    spec = environment.observation_spec()
    assert "pixels" in spec
    assert networks.layout_of(environment) == card_of("walker", "walk").layout
    policies.find(name, environment)


class _Odd(dm_env.Environment):
    """An environment of another class, with unlimited actions of some shape."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape

    def reset(self) -> dm_env.TimeStep:
        return dm_env.restart({"position": np.zeros(2)})

    def step(self, action: Any) -> dm_env.TimeStep:
        return dm_env.transition(0.0, {"position": np.zeros(2)})

    def observation_spec(self) -> Any:
        return {"position": specs.Array((2,), float)}

    def action_spec(self) -> Any:
        return specs.BoundedArray(self._shape, float, -np.inf, np.inf)


def test_any_environment_with_the_right_observations_and_actions_is_played(tmp_path: Path) -> None:
    card = mlp.Card(layout=(("position", (2,)),), low=(-1.0,), high=(1.0,), action_repeat=2)
    mlp.save(tmp_path / "p", drawn(2, 1), card)
    name = f"mlp:{tmp_path / 'p'}"
    environment = _Odd((1,))
    act = policies.find(name, environment).begin_alone(environment, 0)
    assert act(environment.reset().observation).shape == (1,)
    with pytest.raises(PolicyError, match=r"have shape \(1,\); the task's have \(1, 1\)"):
        policies.find(name, _Odd((1, 1)))


def _logged(
    name: str, environment: dm_env.Environment, caplog: pytest.LogCaptureFixture
) -> list[str]:
    caplog.clear()
    with caplog.at_level(logging.INFO, "limberjack"):
        policies.find(name, environment)
    return caplog.messages


def test_scores_of_other_episodes_are_logged_in_one_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    name = write(tmp_path / "p")
    begin = f"policy {name!r}: its scores are those of "
    assert _logged(name, _load(), caplog) == []
    assert _logged(name, _load("walker", "run"), caplog) == [f"{begin}walker walk"]
    heavier = _load()
    heavier.physics.model.body_mass[2] *= 1.01
    assert _logged(name, heavier, caplog) == [f"{begin}another model than this one"]
    old = write(tmp_path / "old", versions={"mujoco": "3.3.0"}, domain="walker", fingerprint="0")
    (line,) = _logged(old, _load("walker", "run"), caplog)
    assert line.startswith(f"policy {old!r}: its scores are those of walker walk and MuJoCo 3.3.0,")
    unknown = write(tmp_path / "unknown", versions={}, fingerprint="", domain="walker")
    assert _logged(unknown, heavier, caplog) == []


@pytest.mark.parametrize(
    ("domain", "task"), [("lqr", "lqr_2_1"), ("reacher", "easy"), ("quadruped", "escape")]
)
def test_what_starts_and_films_set_is_no_other_model(
    domain: str, task: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bounds: dict[str, Any] = {"low": (-1.0,), "high": (1.0,)} if domain == "lqr" else {}
    name = write(tmp_path / "p", domain, task, **bounds)
    environment = suite.load(domain, task, {"random": 5})
    environment.reset()
    environment.physics.model.vis.global_.offwidth = 2000
    assert _logged(name, environment, caplog) == []
    environment.physics.model.opt.timestep *= 2
    assert len(_logged(name, environment, caplog)) == 1


def test_options_of_the_model_may_be_drawn_for_each_episode() -> None:
    draws = {"opt.gravity": scale(0.9, 1.1), "opt.viscosity": shift(0.0, 0.1)}
    env = suite.load("walker", "walk", {"random": 0}, {"randomize": draws})
    env.reset()
    assert policies.find("pretrained", env).name == "pretrained"


def test_a_task_with_a_bundled_policy_is_played_by_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path, ("walker", "walk"), ("point_mass", "easy"))
    environment = _load()
    policy = policies.find("pretrained", environment)
    assert (policy.name, policy.action_repeat) == ("pretrained", 2)
    (expected,) = _totals(
        f"mlp:{tmp_path / 'walker-walk.safetensors'}", "walker", "walk", range(7, 8)
    )
    assert run_episode(environment, policy, 7).total == expected
    first, second = policies.bundled()
    assert (first.domain, first.task) == ("point_mass", "easy")
    assert (second.domain, second.task, second.sha256) == ("walker", "walk", policy.sha256)
    assert second.card == mlp.load(second.path).card
    assert second.nbytes == second.path.stat().st_size


def test_a_task_without_a_bundled_policy_gets_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path / "nothing")
    assert policies.bundled() == []
    with pytest.raises(PolicyError, match="'pretrained': walker walk has none; no task has one"):
        policies.find("pretrained", _load())
    tmp_path.joinpath("some").mkdir()
    bundle(monkeypatch, tmp_path / "some", ("point_mass", "easy"), ("cheetah", "run"))
    choice = "these tasks have one: cheetah run, point_mass easy"
    with pytest.raises(PolicyError, match=f"walker walk has none; {choice}"):
        policies.find("pretrained", _load())
    with pytest.raises(PolicyError, match=f"environment is no task of the suite; {choice}"):
        policies.find("pretrained", _Odd((1,)))


def test_a_damaged_file_is_one_line_that_names_the_policy(tmp_path: Path) -> None:
    write(tmp_path / "p")
    content = (tmp_path / "p").read_bytes()
    (tmp_path / "cut").write_bytes(content[:-1])
    for name, message in (
        ("cut", "policy 'mlp:.*cut' cannot be played: "),
        ("none", "policy 'mlp:.*none': .*No such file"),
        ("", "policy 'mlp:.*': .* is a folder; expected the file that `limberjack train` or mlp.s"),
    ):
        with pytest.raises(PolicyError, match=message) as caught:
            policies.find(f"mlp:{tmp_path / name}", _load())
        assert "\n" not in str(caught.value)


def test_weights_that_give_no_numbers_are_an_error_of_the_step(tmp_path: Path) -> None:
    card = card_of("walker", "walk", end="none")
    # Infinite and minus infinite numbers add up to none.
    first = np.zeros((16, 24)), np.full(16, 3e38)
    second = np.full((16, 16), 3e38), np.zeros(16)
    last = np.tile([1.0, -1.0], (6, 8)), np.zeros(6)
    mlp.save(tmp_path / "p", [first, second, last], card)
    environment = _load()
    policy = policies.find(f"mlp:{tmp_path / 'p'}", environment)
    time_step = environment.reset()
    with pytest.raises(PolicyError, match="step 0 of the episode with seed 7: returned nan"):
        policy.begin_alone(environment, 7)(time_step.observation)


def test_an_evaluation_has_the_episodes_of_single_environments(tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    how: dict[str, Any] = {"time_limit": 0.5, "num_threads": 1}
    played = evaluate("walker", "walk", name, range(60, 67), **how)
    totals = [score.total for score in played.scores[name]]
    assert totals == _totals(name, "walker", "walk", range(60, 67))
    assert played.facts["action_repeat"] == 2
    assert played.facts["policy_sha256"] == policies.find(name, _load()).sha256
    again = evaluate("walker", "walk", name, range(60, 67), action_repeat=2, **how)
    assert [score.total for score in again.scores[name]] == totals
    with pytest.raises(ValueError, match=r"action_repeat is 1, but policy .* acts every 2 con"):
        evaluate("walker", "walk", name, range(3), action_repeat=1, **how)


def _walker(seed: int) -> Environment:
    return suite.load("walker", "walk", {"random": seed, "time_limit": 0.5})


def _slow_walker(seed: int) -> Environment:
    kwargs = {"action_repeat": 4}
    return suite.load("walker", "walk", {"random": seed, "time_limit": 0.5}, kwargs)


def test_environments_of_a_function_are_played_at_the_repeat_of_the_policy(tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    played = evaluate(_walker, None, name, range(3), num_threads=1)
    assert [s.total for s in played.scores[name]] == _totals(name, "walker", "walk", range(3))
    with pytest.raises(ValueError, match=r"action_repeat is 4, but .* acts every 2 control steps"):
        evaluate(_slow_walker, None, name, range(3), num_threads=1)


def test_workers_play_a_network_to_the_same_files(tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    for workers in (None, 2):
        how: dict[str, Any] = {"time_limit": 0.1, "workers": workers}
        evaluate("walker", "walk", name, range(66), out=tmp_path / f"scores-{workers}", **how)
        data.collect("walker", "walk", name, range(66), out=tmp_path / f"data-{workers}", **how)
    results = [(tmp_path / f"scores-{w}" / "result.json").read_bytes() for w in (None, 2)]
    assert results[0] == results[1]
    assert whole_hashes(tmp_path / "data-2") == whole_hashes(tmp_path / "data-None")
    recipe = data.load(tmp_path / "data-2").recipe
    assert (recipe.facts["policy"], recipe.facts["action_repeat"]) == ("mlp:p", 2)


def test_a_file_goes_to_workers_as_bytes_and_a_bundled_policy_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle(monkeypatch, tmp_path, ("walker", "walk"))
    path = tmp_path / "walker-walk.safetensors"
    file, bundled = ship(f"mlp:{path}"), ship("pretrained")
    assert (file.files, bundled.files) == ({path: path.read_bytes()}, None)
    path.rename(tmp_path / "away")
    sha256 = unpack(file, _load(), None).sha256
    (tmp_path / "away").rename(path)
    assert unpack(bundled, _load(), None).sha256 == sha256


def test_a_viewer_repeats_actions_and_begins_each_episode_anew(tmp_path: Path) -> None:
    name = write(tmp_path / "p")
    environment = suite.load("walker", "walk", {"time_limit": 0.5})
    begin = viewer.begin_policy(policies.find(name, environment))
    session = Session(environment, {"policy": begin}, seed=3)
    for expected in _totals(name, "walker", "walk", range(3, 5)):
        for _ in range(20):  # 0.5 s
            session.step()
        assert session.status().total == pytest.approx(expected, rel=1e-12)
        session.step()  # begins the next
