"""The contracts of `Physics` and `Task`: optional methods, defaults and the order of calls."""

from typing import Any

import pytest

from limberjack.rl.contract import Physics, PhysicsError, Task


class _Physics(Physics):
    def __init__(self, diverges: bool = False) -> None:
        self.calls: list[str] = []
        self._diverges = diverges

    def step(self, n_sub_steps: int = 1) -> None:
        self.calls.append("step")

    def time(self) -> float:
        return 0.0

    def timestep(self) -> float:
        return 0.01

    def reset(self) -> None:
        self.calls.append("reset")
        if self._diverges:
            raise PhysicsError("diverged")

    def after_reset(self) -> None:
        self.calls.append("after_reset")


class _Task(Task):
    def initialize_episode(self, physics: Any) -> None:
        pass

    def before_step(self, action: Any, physics: Any) -> None:
        pass

    def action_spec(self, physics: Any) -> Any:
        return None

    def get_observation(self, physics: Any) -> Any:
        return {}

    def get_reward(self, physics: Any) -> Any:
        return 0.0


@pytest.mark.parametrize("diverges", [False, True])
def test_a_reset_context_resets_first_and_follows_the_state_at_its_end(diverges: bool) -> None:
    physics = _Physics(diverges)  # a default state that diverges can be given a good one
    with physics.reset_context() as given:
        assert given is physics
        physics.calls.append("body")
    assert physics.calls == ["reset", "body", "after_reset"]


def test_an_error_within_a_reset_context_leaves_the_state_unchanged() -> None:
    physics = _Physics()
    with pytest.raises(KeyError), physics.reset_context():
        raise KeyError
    assert physics.calls == ["reset"]


@pytest.mark.parametrize("lacking", ["step", "time", "timestep", "reset", "after_reset"])
def test_a_physics_without_a_required_method_cannot_be_made(lacking: str) -> None:
    methods = {name: value for name, value in vars(_Physics).items() if name != lacking}
    with pytest.raises(TypeError, match=lacking):
        type("Incomplete", (Physics,), methods)()


@pytest.mark.parametrize("optional", ["step_spec", "observation_spec"])
def test_an_undefined_spec_names_the_task(optional: str) -> None:
    with pytest.raises(NotImplementedError, match=f"_Task does not define {optional}"):
        getattr(_Task(), optional)(None)


def test_by_default_a_task_never_terminates_and_does_nothing_after_a_step() -> None:
    task = _Task()
    assert task.get_termination(None) is None
    task.after_step(None)


def test_a_physics_without_set_control_is_named() -> None:
    with pytest.raises(NotImplementedError, match="_Physics does not define set_control"):
        _Physics().set_control([0.0])
