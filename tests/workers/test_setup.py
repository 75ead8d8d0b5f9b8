"""Setups, and the proof that a process plays the same bits."""

import dataclasses
import pickle
import socket
import sys
import threading
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.policies import PolicyError, mlp
from limberjack.rl import control
from limberjack.rl.batches import vectorisable
from limberjack.workers import Setup, prepare
from limberjack.workers.setup import Refused
from tests import plain_domain

from . import playing
from .playing import TASK


def _copy(setup: Setup) -> Setup:
    """The setup as a worker receives it."""
    return pickle.loads(pickle.dumps(setup))


def test_a_setup_is_small_and_opens_what_was_prepared() -> None:
    setup = prepare(*TASK, "random", time_limit=0.2)
    assert len(pickle.dumps(setup)) < 2000
    here = _copy(setup).opened()
    assert vectorisable(here.environment).step_limit == 10
    assert vectorisable(here.factory.lasting().make(0)).step_limit == 1000
    assert here.actor.name == "random"
    assert here.actor.sha256 == setup.identity["policy_sha256"]


def test_a_setup_is_opened_once_in_each_thread() -> None:
    setup = prepare(*TASK, "random")
    first = _copy(setup).opened()
    assert _copy(setup).opened() is first
    others = []
    thread = threading.Thread(target=lambda: others.append(setup.opened()))
    thread.start()
    thread.join()
    assert others[0].environment is not first.environment


def _repeating(seed: int) -> control.Environment:
    """An environment that repeats actions itself."""
    return control.Environment(*_parts(seed), time_limit=0.5, action_repeat=3)


def _parts(seed: int) -> Any:
    made = plain_domain.make(seed)
    return made.physics, made.task


def test_actions_are_repeated_as_asked_or_demanded_or_as_the_environment_does(
    tmp_path: Path,
) -> None:
    layout = (("orientation", (2,)), ("velocity", (1,)))
    card = mlp.Card(layout=layout, low=(-1.0,), high=(1.0,), action_repeat=4)
    mlp.save(tmp_path / "p.safetensors", [(np.ones((1, 3), np.float32), np.zeros(1))], card)
    policy = f"mlp:{tmp_path}/p.safetensors"
    setup = prepare(*TASK, policy)
    assert setup.action_repeat == setup.identity["action_repeat"] == 4
    assert setup.opened().actor.action_repeat == 4
    with pytest.raises(ValueError, match=r"action_repeat is 2, but policy .* acts every 4 control"):
        prepare(*TASK, policy, action_repeat=2)
    for asked, repeat in ((None, 3), (2, 2)):
        assert prepare(_repeating, policy="random", action_repeat=asked).action_repeat == repeat
    assert prepare(*TASK, "random").action_repeat == 1


def test_a_world_is_that_of_the_opened_environment() -> None:
    setup = _copy(prepare(*TASK, "random", world={"faults": {"dummies": 1}}))
    assert "dummy-0" in setup.opened().environment.reset().observation


def test_few_setups_stay_open() -> None:
    first = prepare(*TASK, "random")
    opened = first.opened()
    for steps in range(1, 6):
        prepare(*TASK, "random", time_limit=steps * 0.02).opened()
        if steps == 3:  # as many as an evaluation has, and one more
            assert first.opened() is opened
    for steps in range(1, 5):
        prepare(*TASK, "random", time_limit=steps * 0.02).opened()
    assert first.opened() is not opened


def test_another_policy_and_other_threads_keep_the_task() -> None:
    setup = prepare(*TASK, "tests.workers.playing:Memory", time_limit=0.2)
    assert setup.unit_size == 1  # an object with a reset plays alone
    expected = prepare(*TASK, "zero", time_limit=0.2)
    zero = setup.with_policy("zero", policies.find("zero"), expected.identity)
    assert vars(zero) == {**vars(expected), "made": setup.made}
    assert zero.unit_size == 64
    assert dataclasses.replace(zero, num_threads=3).opened().actor.name == "zero"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"versions": {"mujoco": "3.9.0"}},
            "its versions.mujoco is '4.*', and the driver's is '3.9.0'",
        ),
        ({"fingerprint": "0"}, "its fingerprint is '"),
        ({"policy_sha256": "0"}, "its policy_sha256 is '"),
        ({"control_timestep": 1.0}, "its control_timestep is 0.02, and the driver's is 1.0"),
    ],
)
def test_another_identity_is_refused_with_node_and_field(
    change: dict[str, Any], message: str
) -> None:
    setup = prepare(*TASK, "random")
    other = dataclasses.replace(setup, identity={**setup.identity, **change})
    with pytest.raises(Refused, match=message) as caught:
        other.opened()
    assert str(caught.value).startswith(f"node {socket.gethostname()} is refused: its ")


def test_another_canary_is_refused_unless_any_processor_will_do() -> None:
    other = dataclasses.replace(prepare(*TASK, "random"), canary="0")
    with pytest.raises(Refused, match=r"its canary is .*, and the driver's is '0': .*--any-proc"):
        other.opened()
    assert dataclasses.replace(other, any_processor=True).opened().actor


def test_a_policy_whose_file_has_changed_since_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "changed_later.py"
    module.write_text("def act(observation):\n    return [0.0]\n")
    monkeypatch.syspath_prepend(tmp_path)
    setup = prepare(*TASK, "changed_later:act")
    module.write_text("def act(observation):\n    return [0.5]\n")
    with pytest.raises(Refused, match="its policy_sha256 is "):
        setup.opened()


def test_an_environment_that_a_function_makes_is_imported_by_name() -> None:
    setup = _copy(prepare(playing.plain, policy="random"))
    assert setup.identity["environment"] == "tests.workers.playing:plain"
    assert vectorisable(setup.opened().environment).step_limit == 25
    other = prepare(playing.heavy_plain, policy="random")
    assert other.identity["fingerprint"] != setup.identity["fingerprint"]


def test_what_other_processes_cannot_import_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="cannot be imported by other processes: define make"):
        prepare(lambda seed: plain_domain.make(seed), policy="random")
    with pytest.raises(PolicyError, match="that other processes cannot import by that name"):
        prepare(*TASK, lambda observation: [0.0])
    typed_in = types.ModuleType("typed_in")
    exec("def act(observation):\n    return [0.0]\n", vars(typed_in))
    monkeypatch.setitem(sys.modules, "typed_in", typed_in)
    with pytest.raises(PolicyError, match="'typed_in:act' has no source file, so other processes"):
        prepare(*TASK, typed_in.act)

    def make(seed: int) -> Any:
        return plain_domain.make(seed)

    make.__module__, make.__qualname__ = "__main__", "make"
    monkeypatch.setattr(sys.modules["__main__"], "make", make, raising=False)
    with pytest.raises(ValueError, match="__main__:make cannot be imported by other processes"):
        prepare(make, policy="random")
    module = types.ModuleType("only_here")
    module.__dict__.update({name: getattr(suite.pendulum, name) for name in dir(suite.pendulum)})
    module.__name__ = "only_here"
    monkeypatch.setitem(suite._DOMAINS, "only_here", module)
    with pytest.raises(ValueError, match="another process cannot import it: move it into its own"):
        prepare("only_here", "swingup", "random")


def test_a_domain_of_your_own_is_registered_where_it_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "swinging.py").write_text(
        "from limberjack.suite.pendulum import *\nfrom limberjack.suite import pendulum\n"
        "SUITE = pendulum.SUITE\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    suite.register("swinging", "swinging")
    try:
        pickled = pickle.dumps(prepare("swinging", "swingup", "random"))
    finally:
        suite.unregister("swinging")
    monkeypatch.delitem(sys.modules, "swinging")
    try:
        assert pickle.loads(pickled).opened().actor.name == "random"
    finally:
        suite.unregister("swinging")
