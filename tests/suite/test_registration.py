"""Registering domains: names, conflicts, constants, entry points, pickles."""

import copy
import importlib
import pickle
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest

from limberjack import registry, suite
from limberjack.registry import Row
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.shared_streams import fingerprint
from limberjack.rl.streams import set_stream_fields
from limberjack.suite import _registration, base, humanoid
from limberjack.utils import containers
from tests import tutorial
from tests.warm import run

_ID = "limberjack/swing-swing_up-v0"
_TASK = ("swing", "swing_up")
_CONSTANTS = ["ALL_TASKS", "BENCHMARKING", "EASY", "HARD", "EXTRA", "REWARD_VIZ", "NO_REWARD_VIZ"]
_CONSTANTS += ["TASKS_BY_DOMAIN"]


def _constants() -> dict[str, object]:
    return {name: getattr(suite, name) for name in _CONSTANTS}


@pytest.fixture(autouse=True)
def _nothing_stays() -> Iterator[None]:
    """Restores the domains, in their order, and removes the modules that a test has added."""
    own, before = dict(registry.domains()), _constants()
    yield
    if list(registry.domains().items()) != list(own.items()):
        for name in list(registry.domains()):
            registry.remove(name)
        for domain in own.values():
            registry.add(domain)
    for name in [n for n in sys.modules if n.partition(".")[0] == "my_package"]:
        del sys.modules[name]
    for name, value in before.items():
        setattr(suite, name, value)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty directory on the module search path."""
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.fixture
def swing(site: Path) -> ModuleType:
    """The tutorial's module, which does not register itself."""
    tutorial.install(site, with_entry_point=False, registers=False)
    return importlib.import_module(tutorial.MODULE)


def test_a_registered_domain_is_loaded_single_and_batched(swing: ModuleType) -> None:
    suite.register("swing", swing)
    env = suite.load(*_TASK, {"random": 3})
    batch = suite.load_batch(*_TASK, 2, 1, seed=3)
    first, started = env.reset(), batch.reset()
    assert isinstance(env.physics, swing.Physics)
    for name, value in first.observation.items():
        np.testing.assert_array_equal(started.observation[name][0], value)


@pytest.mark.parametrize("given", ["module", "name"])
def test_constants_are_appended_to_and_the_benchmarks_are_not(
    swing: ModuleType, given: str
) -> None:
    before = _constants()
    suite.register("swing", swing if given == "module" else tutorial.MODULE)
    for name in ("ALL_TASKS", "EXTRA", "REWARD_VIZ"):
        assert getattr(suite, name) == (*before[name], _TASK), name  # pyright: ignore
    for name in ("BENCHMARKING", "EASY", "HARD", "NO_REWARD_VIZ"):
        assert getattr(suite, name) == before[name], name
    assert suite.TASKS_BY_DOMAIN["swing"] == ("swing_up",)
    assert _TASK in suite.tasks()
    assert _TASK in suite.tasks("easy")
    suite.unregister("swing")
    assert _constants() == before
    with pytest.raises(ValueError, match="Domain 'swing' does not exist"):
        suite.load(*_TASK)


def test_a_task_whose_reward_is_not_shown_is_in_the_other_constant(swing: ModuleType) -> None:
    swing.SUITE.add("no_reward_visualization")(_named("dark", swing.swing_up))
    suite.register("swing", swing)
    assert ("swing", "dark") in suite.NO_REWARD_VIZ
    assert ("swing", "dark") not in suite.REWARD_VIZ


def _named(name: str, factory: object) -> object:
    def other(time_limit=10, random=None, environment_kwargs=None):
        assert callable(factory)
        return factory(time_limit, random, environment_kwargs)

    other.__name__ = name
    return other


def test_a_task_that_is_added_later_is_loaded_listed_and_batched(swing: ModuleType) -> None:
    suite.register("swing", swing)
    swing.SUITE.add("custom")(_named("later", swing.swing_up))
    assert suite.tasks("custom") == suite._get_tasks("custom") == (("swing", "later"),)
    assert suite.load("swing", "later").reset().first()
    assert suite.load_batch("swing", "later", 2, 1).reset().reward.shape == (2,)


def test_registering_the_same_module_again_changes_nothing(swing: ModuleType) -> None:
    suite.register("swing", swing)
    after = _constants()
    suite.register("swing", swing)
    suite.register("swing", tutorial.MODULE)
    suite.register("humanoid", humanoid)
    assert _constants() == after


def test_another_module_under_a_taken_name_is_refused_and_both_are_named(
    swing: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = ModuleType("other_swing")
    vars(other).update(vars(swing), __name__="other_swing")
    suite.register("swing", swing)
    with pytest.raises(ValueError, match=r"as my_package\.swing; give other_swing another name"):
        suite.register("swing", other)
    with pytest.raises(ValueError, match="'humanoid' belongs to the suite"):
        suite.register("humanoid", swing)
    suite.unregister("swing")
    suite.register("swing", other)
    assert suite.module_of("swing") is other


def test_a_domain_that_was_assigned_is_registered_if_it_is_the_same_module(
    swing: ModuleType,
) -> None:
    suite._DOMAINS["swing"] = swing
    assert _TASK not in suite.ALL_TASKS
    other = ModuleType("other_swing")
    vars(other).update(vars(swing), __name__="other_swing")
    with pytest.raises(ValueError, match=r"as my_package\.swing; give other_swing another name"):
        suite.register("swing", other)
    suite.register("swing", swing)
    assert _TASK in suite.ALL_TASKS


def test_only_registered_domains_can_be_unregistered() -> None:
    with pytest.raises(ValueError, match="no domain 'swing'"):
        suite.unregister("swing")
    with pytest.raises(ValueError, match="'humanoid' belongs to the suite"):
        suite.unregister("humanoid")


def test_a_module_that_fails_the_checks_is_not_registered(swing: ModuleType) -> None:
    before = _constants()
    swing.SUITE.add()(_named("fails", lambda *given: 1 / 0))
    with pytest.raises(ValueError, match="factory fails raises ZeroDivisionError"):
        suite.register("swing", swing)
    assert "swing" not in registry.domains()
    assert _constants() == before
    assert _ID not in gymnasium.registry


def test_values_that_are_not_modules_are_type_errors() -> None:
    with pytest.raises(TypeError, match="expected a module, or its dotted name"):
        suite.register("swing", 3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        suite.register("swing", "no_such_module")


# dm_control's mapping.


def test_the_mapping_of_domains_can_be_set_updated_and_deleted_from(swing: ModuleType) -> None:
    before = _constants()
    suite._DOMAINS["swing"] = swing
    assert suite._DOMAINS["swing"] is swing
    assert suite.load(*_TASK).reset().first()
    assert _TASK in suite._get_tasks(None)
    assert _constants() == before
    suite._DOMAINS.update(pole=swing)
    assert {"swing", "pole"} < set(suite._DOMAINS)
    del suite._DOMAINS["pole"]
    assert "pole" not in suite._DOMAINS
    assert suite._DOMAINS.copy() == dict(suite._DOMAINS) == suite._DOMAINS | {}


def test_another_dict_may_be_put_for_the_mapping_of_domains(swing: ModuleType) -> None:
    """As programs for dm_control do: `suite._DOMAINS = {**suite._DOMAINS, "mine": module}`."""
    mapping, before = suite._DOMAINS, set(suite._DOMAINS)
    like_a_module = SimpleNamespace(SUITE=swing.SUITE)
    others: Any = {"swing": swing, "like": like_a_module}
    suite._DOMAINS = suite._DOMAINS | others  # pyright: ignore[reportAttributeAccessIssue]
    assert suite._DOMAINS is mapping
    assert set(suite._DOMAINS) == before | {"swing", "like"}
    for name in ("swing", "like"):
        assert suite.load(name, _TASK[1]).reset().first()
    left = {name: mapping[name] for name in before}
    suite._DOMAINS = left  # pyright: ignore[reportAttributeAccessIssue]
    assert set(suite._DOMAINS) == before
    with pytest.raises(ValueError, match="Domain 'like' does not exist"):
        suite.load("like", _TASK[1])
    with pytest.raises(TypeError, match="expected a module with a SUITE"):
        suite._DOMAINS["odd"] = importlib.import_module("colorsys")


def test_a_domain_of_the_suite_can_be_replaced_in_the_mapping(swing: ModuleType) -> None:
    suite._DOMAINS["stacker"] = swing
    assert isinstance(suite.load("stacker", "swing_up").physics, swing.Physics)
    assert "limberjack/stacker-stack_2-v0" not in gymnasium.registry


def test_checking_whether_a_domain_exists_imports_nothing() -> None:
    run(
        """
        import sys
        from limberjack import suite
        assert "humanoid" in suite._DOMAINS and "wanderer" not in suite._DOMAINS
        assert list(suite._DOMAINS)[:3] == ["acrobot", "ball_in_cup", "cartpole"]
        assert not {"limberjack.suite.humanoid", "limberjack.suite.stacker"} & set(sys.modules)
        assert suite.humanoid.SUITE is suite._DOMAINS["humanoid"].SUITE
        from limberjack.suite import stacker
        assert stacker is sys.modules["limberjack.suite.stacker"]
        assert "limberjack.suite.manipulator" not in sys.modules
        assert "manipulator" in dir(suite)
        """
    )


def test_an_unknown_domain_is_not_an_attribute() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'wanderer'"):
        _ = suite.wanderer


# Entry points.


def test_a_domain_of_an_installed_package_is_found_by_name_and_changes_no_constant(
    site: Path,
) -> None:
    tutorial.install(site, registers=False)
    before = _constants()
    assert "swing" not in registry.domains()
    assert suite.load(*_TASK).reset().first()
    assert registry.domains()["swing"].source == "installed"
    assert _constants() == before
    assert _TASK in suite.tasks()


def test_a_module_of_a_package_may_register_itself(site: Path) -> None:
    tutorial.install(site)
    assert suite.load(*_TASK).reset().first()
    assert _TASK in suite.ALL_TASKS


def test_all_installed_domains_are_found_and_broken_ones_reported(site: Path) -> None:
    tutorial.install(site, registers=False)
    lines = ["[limberjack.domains]", "swing = my_package.swing", "humanoid = my_package.body"]
    lines += ["gone = my_package.gone", "empty = my_package", ""]
    (site / "my_package-1.0.dist-info" / "entry_points.txt").write_text("\n".join(lines))
    problems = suite.find_installed()
    assert set(problems) == {"humanoid", "gone", "empty"}
    assert "belongs to the suite" in problems["humanoid"]
    assert "cannot be imported: No module named 'my_package.gone'" in problems["gone"]
    assert "SUITE is missing" in problems["empty"]
    assert "swing" in registry.domains()
    assert isinstance(suite.load("humanoid", "stand").physics, humanoid.Physics)


def test_entry_points_are_not_read_before_a_name_is_missing(site: Path) -> None:
    tutorial.install(site)
    run(
        """
        import sys
        import limberjack.suite
        limberjack.suite.load("stacker", "stack_2")
        assert "limberjack.suite._entry_points" not in sys.modules
        assert "my_package" not in sys.modules
        """,
        path=site,
    )


# Gymnasium, pickles, other processes.


def test_registering_a_domain_registers_its_gymnasium_ids(swing: ModuleType) -> None:
    assert _ID not in gymnasium.registry
    suite.register("swing", swing)
    spec = gymnasium.spec(_ID)
    assert spec.max_episode_steps == 500
    of_domain = {"module": tutorial.MODULE, "steps": 500}
    assert spec.kwargs == {"domain": "swing", "task": "swing_up", **of_domain}
    envs = gymnasium.make_vec(_ID, num_envs=2)
    assert envs.reset(seed=0)[0]["orientation"].shape == (2, 2)
    suite.unregister("swing")
    assert _ID not in gymnasium.registry


_READ = """
import pickle, sys
from limberjack import suite
from pathlib import Path
{before}
env = pickle.loads(Path(sys.argv[1]).read_bytes())
print("swing" in suite._DOMAINS, suite.load("swing", "swing_up").reset().first())
"""


@pytest.mark.parametrize("what", ["environment", "batch", "snapshot"])
def test_a_pickle_registers_its_domain_in_another_process(
    swing: ModuleType, site: Path, what: str
) -> None:
    suite.register("swing", swing)
    env = suite.load(*_TASK, {"random": 0})
    env.reset()
    batch = suite.load_batch(*_TASK, 2, 1)
    batch.reset()
    objects = {"environment": env, "batch": batch, "snapshot": env.snapshot()}
    (site / "pickle").write_bytes(pickle.dumps(objects[what]))
    printed = run(_READ.format(before=""), str(site / "pickle"), path=site)
    assert printed == "True True\n"


def test_a_domain_that_was_assigned_counts_by_itself_here_and_elsewhere(
    swing: ModuleType, site: Path
) -> None:
    suite._DOMAINS["swing"] = swing
    spec = gymnasium.make(_ID, time_limit=0.06).spec
    assert spec is not None
    assert spec.max_episode_steps is None
    printed = run(
        """
        import sys
        import gymnasium
        from gymnasium.envs.registration import EnvSpec
        env = gymnasium.make(EnvSpec.from_json(sys.argv[1]))
        env.reset(seed=0)
        print([env.step(env.action_space.sample())[3] for _ in range(3)])
        """,
        spec.to_json(),
        path=site,
    )
    assert printed == "[False, False, True]\n"


def test_assigned_domains_need_not_pass_the_checks_and_may_have_any_name(
    swing: ModuleType, site: Path
) -> None:
    text = "from my_package.swing import swing_up\nSUITE = {'up': swing_up}\n"
    (site / "plain.py").write_text(text)
    plain = importlib.import_module("plain")
    suite._DOMAINS["plain pole"] = plain
    env = suite.load("plain pole", "up", {"random": 0})
    (site / "pickle").write_bytes(pickle.dumps(env))
    assert not [name for name in gymnasium.registry if "plain" in name]
    program = """
    import pickle, sys
    from pathlib import Path
    from limberjack import suite
    pickle.loads(Path(sys.argv[1]).read_bytes())
    print(suite.load("plain pole", "up").reset().first())
    """
    assert run(program, str(site / "pickle"), path=site) == "True\n"


def test_a_pickle_of_another_domain_of_that_name_is_refused(swing: ModuleType, site: Path) -> None:
    suite.register("swing", swing)
    (site / "pickle").write_bytes(pickle.dumps(suite.load(*_TASK)))
    (site / "other.py").write_text((site / "my_package" / "swing.py").read_text())
    before = """
    suite.register("swing", "other")
    try:
        pickle.loads(Path(sys.argv[1]).read_bytes())
    except ValueError as error:
        print(error)
    sys.exit()
    """
    program = _READ.format(before=textwrap.dedent(before))
    printed = run(program, str(site / "pickle"), path=site)
    assert "registered already, as other; give my_package.swing another name" in printed


def test_a_domain_without_a_module_is_copied_and_refused_when_pickled(swing: ModuleType) -> None:
    memory = ModuleType("memory")
    vars(memory).update({k: v for k, v in vars(swing).items() if not k.startswith("__")})
    suite.register("swing", memory)
    env = suite.load(*_TASK, {"random": 0})
    env.reset()
    batch = suite.load_batch(*_TASK, 2, 1)
    assert copy.deepcopy(env).step([0.5]).reward == env.step([0.5]).reward
    assert isinstance(copy.deepcopy(batch), BatchEnvironment)
    for what in (env, batch, env.snapshot(), gymnasium.spec(_ID)):
        with pytest.raises(pickle.PicklingError, match="move it into its own module"):
            pickle.dumps(what)
    assert gymnasium.make(_ID).reset(seed=0)[0]["velocity"].shape == (1,)


def test_environments_of_the_suite_carry_their_domain_too() -> None:
    env = suite.load("stacker", "stack_2", {"random": 0})
    env.reset()
    twin = pickle.loads(pickle.dumps(env))
    assert (twin.registration.name, twin.registration.module) == (
        "stacker",
        "limberjack.suite.stacker",
    )


def _module(*factories: Callable[..., object], **attributes: object) -> ModuleType:
    """A module with these factories as its tasks."""
    module = ModuleType("made")
    tasks = containers.TaggedTasks()
    for factory in factories:
        tasks.add()(factory)
    vars(module).update(attributes, SUITE=tasks)
    return module


# Any: keyword arguments of the factories of the suite.
def good(**kwargs: Any) -> control.Environment:
    return humanoid.stand(**kwargs)


class _Heavy(humanoid.Humanoid):
    """A humanoid of another weight for each seed."""

    EPISODE_FIELDS = ("body_mass",)

    def begin_stream(self, random: np.random.RandomState) -> dict[str, np.ndarray]:
        return {"body_mass": np.full(17, random.uniform(1, 9))}


def heavy(random: Any = None, **kwargs: Any) -> control.Environment:
    env = humanoid.stand(random=random, **kwargs)
    env._task = _Heavy(0, False, random)
    return env


def heavy_itself(random: Any = None, **kwargs: Any) -> control.Environment:
    env = heavy(random, **kwargs)
    set_stream_fields(env.task, env.task.random, env.physics.simulation)
    return env


@pytest.mark.parametrize("factory", [heavy, heavy_itself])
def test_the_fields_of_a_seed_are_set_once_whatever_the_factory_does(factory: Any) -> None:
    suite.register("made", _module(factory))
    name = factory.__name__
    expected = np.random.RandomState(3)
    mass = expected.uniform(1, 9)
    single = suite.load("made", name, {"random": 3})
    assert single.physics.model.body_mass[2] == mass
    assert single.task.random.uniform() == expected.uniform()
    batch = suite.load_batch("made", name, 2, seed=3)
    batch.reset()
    assert batch.physics.model.body_mass[0, 2] == mass
    assert (
        suite.load("made", name).physics.model.body_mass[2]
        != humanoid.stand().physics.model.body_mass[2]
    )


def _with(**attributes: object) -> Callable[..., object]:
    """A factory whose task has these attributes."""

    def odd(**kwargs: Any) -> control.Environment:
        env = humanoid.stand(**kwargs)
        vars(env.task).update(attributes)
        return env

    return odd


def test_the_rows_have_the_tags_the_length_and_the_degrees_of_freedom_of_each_task() -> None:
    module = _module(good)

    def short(time_limit=1, random=None, environment_kwargs=None):
        return humanoid.stand(time_limit, random, environment_kwargs=environment_kwargs)

    def endless(random: Any = None, **kwargs: Any) -> control.Environment:
        return humanoid.stand(float("inf"), random, **kwargs)

    module.SUITE.add("easy", "mine")(short)
    module.SUITE.add("mine")(endless)
    assert _registration.rows_of("body", module) == (
        Row("body", "good", (), 1000, 27, 21, 67),
        Row("body", "short", ("easy", "mine"), 40, 27, 21, 67),
        Row("body", "endless", ("mine",), None, 27, 21, 67),
    )


def test_the_modules_of_the_suite_pass() -> None:
    rows = _registration.rows_of("humanoid", humanoid)
    assert [row.task for row in rows] == list(humanoid.SUITE)


def test_everything_that_is_wrong_is_in_one_numbered_message() -> None:
    def takes_nothing() -> None: ...

    def fails(**kwargs: object) -> None:
        raise KeyError("no model")

    def returns_nothing(**kwargs: object) -> None: ...

    broken = _module(takes_nothing, fails, good, returns_nothing, PICTURES={"none": 3})
    with pytest.raises(ValueError, match="domain 'my-broken', module made, cannot be") as error:
        _registration.rows_of("my-broken", broken)
    for part in (
        ": (1) the name 'my-broken' is not a Python identifier; (2) ",
        "PICTURES has a task 'none', SUITE has not",
        "PICTURES['none'] is 3; expected a limberjack.suite.base.Picture",
        "factory takes_nothing does not accept time_limit, random, environment_kwargs",
        "factory fails raises KeyError: 'no model'",
        "(6) factory returns_nothing returns a NoneType; expected a control.Environment, or "
        "another dm_env.Environment",
    ):
        assert part in str(error.value)
    assert "good" not in str(error.value)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"GOAL": "high"}, "GOAL = 'high'; expected a tuple of names"),
        ({"STARTS": ("one", 2)}, r"STARTS = \('one', 2\); expected a tuple of names"),
        ({"EPISODE_FIELDS": ["body_pos"]}, r"EPISODE_FIELDS = \['body_pos'\]; expected a tuple"),
        ({"planner_cost": "no_colon"}, "planner_cost = 'no_colon'; expected 'module:Class'"),
        ({"planner_cost": humanoid}, "planner_cost = <module .*; expected 'module:Class'"),
    ],
)
def test_attributes_of_a_task_that_other_modules_read_are_checked(
    attributes: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=f"the task of odd has {message}"):
        _registration.rows_of("body", _module(_with(**attributes)))


class _Odd(humanoid.Humanoid):
    """Misspells a joint as an episode begins."""

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["rooot"] = 0.0


class _Without(humanoid.Humanoid):
    GOAL = ("standig",)


class _Nothing(humanoid.Humanoid):
    def get_observation(self, physics: Any) -> Any:
        physics.head_height()


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            _Odd,
            "raises KeyError in its first step: .*'rooot'. Did you mean 'root'",
        ),
        (_Without, "raises ValueError in its first step: GOAL of task _Without names 'standig'"),
        (_Nothing, "raises TypeError in its first step: get_observation returned None; expected"),
        (None, "has another stream each time for random=0: give the task `random`"),
    ],
)
def test_mistakes_that_a_first_step_shows_are_found(kind: Any, message: str) -> None:
    def odd(random: Any = None, **kwargs: Any) -> control.Environment:
        if kind is None:
            return humanoid.stand(**kwargs)
        env = humanoid.stand(random=random, **kwargs)
        env._task = kind(0, False, random)
        return env

    before = fingerprint(np.random)
    with pytest.raises(ValueError, match=f"the environment of odd {message}"):
        _registration.rows_of("body", _module(odd))
    assert fingerprint(np.random) == before


def test_a_cost_with_a_module_and_a_class_is_accepted() -> None:
    (row,) = _registration.rows_of("body", _module(_with(planner_cost="my_package.cost:Cost")))
    assert row.task == "odd"


@pytest.mark.parametrize("keyword", ["time_limit", "random", "environment_kwargs"])
def test_a_keyword_that_a_factory_does_not_take_is_named(keyword: str) -> None:
    factories: dict[str, Callable[..., object]] = {
        "time_limit": lambda random=None, environment_kwargs=None: None,
        "random": lambda time_limit=1, environment_kwargs=None: None,
        "environment_kwargs": lambda time_limit=1, random=None: None,
    }
    lacking = factories[keyword]
    lacking.__name__ = "lacking"
    with pytest.raises(ValueError, match=f"factory lacking does not accept {keyword}$"):
        _registration.rows_of("body", _module(lacking))


def test_pictures_may_be_given_for_some_tasks_as_a_mapping_only() -> None:
    assert _registration.rows_of(
        "body", _module(good, PICTURES={"good": base.Picture(camera="side")})
    )
    with pytest.raises(ValueError, match=r"PICTURES is \[\]; expected a base\.Picture for each"):
        _registration.rows_of("body", _module(good, PICTURES=[]))


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        (None, "SUITE is missing; expected a limberjack.utils.containers.TaggedTasks"),
        ({}, "SUITE is {}; expected a limberjack.utils.containers.TaggedTasks"),
        (containers.TaggedTasks(), "SUITE has no tasks; decorate each factory"),
    ],
    ids=repr,
)
def test_a_module_without_tasks_is_refused(tasks: object, message: str) -> None:
    module = ModuleType("empty")
    if tasks is not None:
        module.SUITE = tasks  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match=message):
        _registration.rows_of("empty", module)


def test_a_task_that_no_id_can_name_is_refused() -> None:
    module = ModuleType("made")
    tasks = containers.TaggedTasks()
    factory: Callable[..., object] = lambda **kwargs: good(**kwargs)  # noqa: E731
    factory.__name__ = "no-name"
    tasks.add()(factory)
    module.SUITE = tasks  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match="the task name 'no-name' is not a Python identifier"):
        _registration.rows_of("body", module)
