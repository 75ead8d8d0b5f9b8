"""Stand-ins for the parts of dm_control that are not implemented."""

import re
from pathlib import Path

from tests.programs import INSTALL, errors_of, run

STAND_INS = [
    "dm_control.composer",
    "dm_control.composer.variation.distributions",
    "dm_control.entities.manipulators",
    "dm_control.locomotion",
    "dm_control.locomotion.walkers.cmu_humanoid",
    "dm_control.manipulation",
    "dm_control.mjcf",
    "dm_control.suite.wrappers.mujoco_profiling",
]


def test_stand_ins_can_be_imported_as_modules_and_from_packages() -> None:
    program = f"""
    import importlib, sys
    {INSTALL}
    for name in sys.argv[1:]:
        module = importlib.import_module(name)
        real = name.replace("dm_control", "limberjack", 1)
        assert module is sys.modules[name] is sys.modules[real]
        assert module.__name__ == module.__spec__.name == real
        assert "not implemented" in module.__doc__
    from dm_control import composer, manipulation, mjcf
    from dm_control.composer.observation import observable
    from dm_control.locomotion.walkers import cmu_humanoid
    from dm_control.locomotion.examples import basic_rodent_2020
    from dm_control.locomotion.soccer import *
    import dm_control.composer.observation.observable
    assert composer is sys.modules["dm_control.composer"]
    assert basic_rodent_2020.rodent_run_gaps.__name__ == "rodent_run_gaps"
    """
    run(program, *STAND_INS)


def test_stand_ins_work_in_annotations_and_checks() -> None:
    program = f"""
    import pickle, typing
    {INSTALL}
    from dm_control import composer, mjcf, suite
    from dm_control.locomotion import soccer
    env = suite.load("humanoid", "stand")
    assert not isinstance(env, composer.Environment)
    assert not isinstance(env, (composer.Environment, mjcf.Physics))
    assert not issubclass(type(env), composer.Environment)
    assert composer.Environment is composer.Environment
    assert composer.Environment is not composer.Task
    assert composer.Environment
    def f(a: composer.Environment | None, b: typing.Optional[mjcf.Physics], c: list[composer.Task],
          d: composer.Environment | int = soccer.WalkerType.BOXHEAD) -> None: ...
    assert composer.Environment.__module__ == "limberjack.composer"
    assert pickle.loads(pickle.dumps(soccer.WalkerType)) is soccer.WalkerType
    import dm_control.locomotion.soccer as module
    assert module is not soccer and module.WalkerType is soccer.WalkerType
    try:
        raise KeyError
    except (composer.EpisodeInitializationError, KeyError):
        pass
    """
    run(program)


_USES = [
    "composer.Environment()",
    "composer.Environment(task=None, time_limit=3)",
    "composer.Environment.make(1)",
    "manipulation.load('stack_2_bricks')",
    "list(manipulation.ALL)",
    "len(manipulation.ALL)",
    "'stack' in manipulation.ALL",
    "manipulation.ALL[0]",
    "composer.cached_property(print)",
    "type(composer.Task)('Mine', (composer.Task,), {})",
    "exec('class Mine(composer.Task): pass')",
    "exec('import abc\\nclass Mine(composer.Task, abc.ABC): pass')",
    "exec('class Mine(composer.SomeError): pass')",
    "composer.SomeError('x')",
]


def test_using_a_stand_in_names_what_is_not_implemented() -> None:
    imports = "from dm_control import composer, manipulation"
    errors = errors_of(*(f"{imports}; {use}" for use in _USES))
    for use, (kind, message) in zip(_USES, errors, strict=True):
        assert kind == "NotImplementedError", use
        assert re.match(r"dm_control\.(composer|manipulation)\.\w+.* is not implemented", message)
        assert "in a separate environment" in message


def test_private_attributes_of_stand_ins_do_not_exist() -> None:
    program = f"""
    import inspect
    {INSTALL}
    from dm_control import composer
    for thing in (composer, composer.Environment, composer.Environment.Part):
        for name in ("__file__", "__wrapped__", "__len_hint__", "_private"):
            assert not hasattr(thing, name), (thing, name)
    assert composer.__path__ == []
    inspect.getmembers(composer), inspect.unwrap(composer.Environment)
    repr(composer), repr(composer.Environment), dir(composer), dir(composer.Environment)
    """
    run(program)
    ((kind, message),) = errors_of("from dm_control import composer; composer._x")
    assert kind == "AttributeError"
    assert "_x" in message


def test_stand_ins_do_not_exist_without_the_installation() -> None:
    program = """
    try:
        import limberjack.composer
    except ModuleNotFoundError as error:
        print(error)
    """
    assert run(program) == "No module named 'limberjack.composer'\n"


def test_a_module_that_is_built_comes_before_its_stand_in(tmp_path: Path) -> None:
    program = f"""
    import sys
    {INSTALL}
    limberjack.__path__.append(sys.argv[1])
    from dm_control import mjcf
    import dm_control.mjcf
    assert mjcf.IS_BUILT and sys.modules["dm_control.mjcf"] is mjcf
    """
    (tmp_path / "mjcf.py").write_text("IS_BUILT = True\n")
    run(program, str(tmp_path))
