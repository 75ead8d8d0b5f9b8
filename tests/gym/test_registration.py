"""Ids, and what registering them costs."""

import pickle
import tomllib
from pathlib import Path

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

import limberjack.gym
from limberjack import gym, suite
from tests.programs import run

_SOURCE = Path(limberjack.gym.__file__).parents[2]
_PTH = _SOURCE / "limberjack-gymnasium.pth"
_IDS = [f"limberjack/{domain}-{task}-v0" for domain, task in suite.ALL_TASKS]


def test_every_task_of_the_suite_is_registered_and_nothing_else() -> None:
    assert sorted(name for name in gymnasium.registry if "limberjack" in name) == sorted(_IDS)


@pytest.mark.parametrize("name", _IDS)
def test_make_gives_the_task_of_the_id(name: str) -> None:
    domain, _, task = name.removeprefix("limberjack/").removesuffix("-v0").partition("-")
    env = gymnasium.make(name, flat=True)
    ours = gym.load(domain, task, flat=True)
    assert isinstance(env.unwrapped, gym.Env)
    assert env.reset(seed=1)[0].tobytes() == ours.reset(seed=1)[0].tobytes()


@pytest.mark.parametrize("name", _IDS)
def test_make_vec_gives_a_batch_of_the_task(name: str) -> None:
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


def test_registering_imports_no_mujoco_and_no_opengl() -> None:
    run(
        """
        import sys
        import limberjack.gym
        assert not {"mujoco", "OpenGL", "glfw", "dm_env"} & set(sys.modules), sys.modules
        """
    )


def test_an_id_with_the_module_needs_no_import() -> None:
    printed = run(
        """
        import gymnasium
        name = "limberjack.gym:limberjack/humanoid-walk-v0"
        env = gymnasium.make(name)
        envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
        print(env.spec.id, envs.num_envs)
        """
    )
    assert printed == "limberjack/humanoid-walk-v0 2\n"


def test_registering_again_changes_nothing() -> None:
    limberjack.gym._register()  # a warning, and so an error, if it did


def test_an_unknown_name_of_the_module_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Enf'"):
        _ = gym.Enf  # pyright: ignore[reportAttributeAccessIssue]


def test_where_it_is_installed_an_id_needs_no_import() -> None:
    # What Python does at its start with the file that the wheel puts beside the package.
    printed = run(
        f"""
        import site
        import sys
        def waiting():
            plugin = "limberjack._gymnasium_plugin"
            return [finder for finder in sys.meta_path if type(finder).__module__ == plugin]
        site.addsitedir({str(_PTH.parent)!r})  # in an installed environment Python did so itself
        assert len(waiting()) == 1
        assert not {{"gymnasium", "numpy", "limberjack.gym"}} & set(sys.modules)
        import gymnasium
        assert not waiting()
        assert "exec_module" not in vars(gymnasium.__spec__.loader)
        assert not {{"mujoco", "dm_env"}} & set(sys.modules)
        name = "limberjack/humanoid-walk-v0"
        env = gymnasium.make(name)
        envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
        print(env.spec.id, envs.num_envs)
        """
    )
    assert printed == "limberjack/humanoid-walk-v0 2\n"


def test_the_wheel_puts_that_file_beside_the_package() -> None:
    project = tomllib.loads((_SOURCE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert included == {f"src/{_PTH.name}": _PTH.name}


def test_a_program_without_gymnasium_does_not_notice_that_file() -> None:
    run(
        f"""
        import site
        import sys
        sys.modules["gymnasium"] = None  # not installed
        site.addsitedir({str(_PTH.parent)!r})
        try:
            import gymnasium
        except ModuleNotFoundError:
            pass
        import json
        """
    )
