"""Ids, and what registering them costs."""

import pickle

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

from limberjack import gym, suite
from tests.programs import run


def _id(domain: str, task: str) -> str:
    return f"limberjack/{domain}-{task}-v0"


_IDS = [_id(*task) for task in suite.ALL_TASKS]

every_task = pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)


def test_every_task_of_the_suite_is_registered_and_one_id_for_several() -> None:
    found = sorted(name for name in gymnasium.registry if "limberjack" in name)
    assert found == sorted([*_IDS, "limberjack/many-v0"])


@every_task
def test_make_gives_the_task_of_the_id(domain: str, task: str) -> None:
    env = gymnasium.make(_id(domain, task), flat=True)
    ours = gym.load(domain, task, flat=True)
    assert isinstance(env.unwrapped, gym.Env)
    assert env.reset(seed=1)[0].tobytes() == ours.reset(seed=1)[0].tobytes()


@every_task
def test_make_vec_gives_a_batch_of_the_task(domain: str, task: str) -> None:
    name = _id(domain, task)
    envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
    assert isinstance(envs.unwrapped, gym.VectorEnv)
    assert envs.num_envs == 2
    assert envs.spec is not None
    assert envs.spec.id == name
    envs.close()


def test_make_vec_prefers_the_batch() -> None:
    envs = gymnasium.make_vec(_IDS[0], num_envs=1, num_threads=1)
    assert isinstance(envs.unwrapped, gym.VectorEnv)
    envs.close()


def test_both_take_the_arguments_of_the_suite() -> None:
    given = {
        "time_limit": 0.05,
        "task_kwargs": {"fully_observable": False},
        "environment_kwargs": {"n_sub_steps": None},
        "flat": True,
        "dtype": "float32",
    }
    env = gymnasium.make("limberjack/stacker-stack_2-v0", **given)
    envs = gymnasium.make_vec(
        "limberjack/stacker-stack_2-v0",
        num_envs=2,
        autoreset_mode="Disabled",
        num_threads=1,
        copy=False,
        on_divergence="raise",
        **given,
    )
    assert env.observation_space == envs.single_observation_space
    assert env.action_space == envs.single_action_space
    assert [part.name for part in env.get_wrapper_attr("layout")] == [
        "arm_pos",
        "arm_vel",
        "touch",
    ]
    envs.close()


def test_a_spec_can_be_stored_and_made_again() -> None:
    spec = gymnasium.make(_IDS[0], flat=True, dtype="float32").spec
    assert spec is not None
    stored = EnvSpec.from_json(spec.to_json())
    assert gymnasium.make(stored).observation_space == spec.make().observation_space
    assert pickle.loads(pickle.dumps(spec)) == spec


def test_importing_the_package_registers_and_imports_no_mujoco_and_no_domain() -> None:
    printed = run(
        """
        import sys
        import limberjack
        heavy = {"mujoco", "OpenGL", "glfw", "dm_env", "limberjack.suite", "limberjack.rl"}
        assert not heavy & set(sys.modules), sys.modules
        import gymnasium
        print(gymnasium.spec("limberjack/humanoid-walk-v0").max_episode_steps)
        """
    )
    assert printed == "1000\n"


@pytest.mark.parametrize("module", ["limberjack", "limberjack.gym"])
def test_an_id_with_the_module_needs_no_import(module: str) -> None:
    printed = run(
        f"""
        import gymnasium
        name = "{module}:limberjack/humanoid-walk-v0"
        env = gymnasium.make(name)
        envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
        print(env.spec.id, envs.num_envs)
        """
    )
    assert printed == "limberjack/humanoid-walk-v0 2\n"


def test_looking_for_gymnasium_first_changes_nothing() -> None:
    # TorchRL calls it.
    printed = run(
        """
        import importlib.util
        importlib.util.find_spec("gymnasium")
        import gymnasium
        import limberjack
        print(gymnasium.make("limberjack/humanoid-walk-v0").spec.id)
        """
    )
    assert printed == "limberjack/humanoid-walk-v0\n"


def test_an_unknown_name_of_the_module_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Enf'"):
        _ = gym.Enf  # pyright: ignore[reportAttributeAccessIssue]
