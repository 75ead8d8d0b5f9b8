"""Tests of limberjack.install_as_dm_control, each in a separate Python process."""

import functools
import json
import re
from pathlib import Path

import pytest

import limberjack
from tests import warm
from tests.contract.extras import MISSING
from tests.programs import INSTALL

# In processes that have imported nothing of this package, and no MuJoCo.
run = functools.partial(warm.run, imports="import gymnasium, numpy")

# Modules that programs for dm_control import, and the names they use.
IMPORTED = {
    "dm_control.mujoco": ["Physics", "MovableCamera", "Camera", "TextOverlay", "action_spec"],
    "dm_control.mujoco.engine": ["Physics", "Camera", "MovableCamera"],
    "dm_control.mujoco.index": [],
    "dm_control.mujoco.math": [],
    "dm_control.mujoco.wrapper": ["MjModel", "MjData", "MjvOption", "mjbindings"],
    "dm_control.mujoco.wrapper.core": ["MjModel", "MjData"],
    "dm_control.mujoco.wrapper.mjbindings": ["enums", "constants", "functions", "mjlib"],
    "dm_control.mujoco.wrapper.mjbindings.constants": [],
    "dm_control.mujoco.wrapper.mjbindings.enums": ["mjtObj"],
    "dm_control.mujoco.wrapper.mjbindings.functions": [],
    "dm_control.mujoco.wrapper.util": [],
    "dm_control.rl": ["control"],
    "dm_control.rl.control": ["Environment", "Task", "Physics", "PhysicsError"],
    "dm_control.suite": ["load", "ALL_TASKS", "BENCHMARKING", "_DOMAINS", "_get_tasks"],
    "dm_control.suite.base": ["Task"],
    "dm_control.suite.common": ["read_model", "ASSETS"],
    "dm_control.suite.humanoid": ["Physics", "Humanoid", "walk", "SUITE"],
    "dm_control.suite.manipulator": ["Physics", "Bring", "make_model", "SUITE"],
    "dm_control.suite.stacker": ["Physics", "Stack", "make_model", "SUITE"],
    "dm_control.suite.utils": ["parse_amc", "randomizers"],
    "dm_control.suite.utils.parse_amc": ["convert", "Converted", "MOCAP_DT"],
    "dm_control.suite.utils.randomizers": ["randomize_limited_and_rotational_joints"],
    "dm_control.suite.wrappers": ["pixels", "action_scale", "action_noise"],
    "dm_control.suite.wrappers.action_noise": ["Wrapper"],
    "dm_control.suite.wrappers.action_scale": ["Wrapper"],
    "dm_control.suite.wrappers.pixels": ["Wrapper"],
    "dm_control.utils": ["containers", "io", "rewards", "xml_tools", "transformations"],
    "dm_control.utils.containers": ["TaggedTasks"],
    "dm_control.utils.inverse_kinematics": ["qpos_from_site_pose", "IKResult"],
    "dm_control.utils.io": ["GetResource"],
    "dm_control.utils.rewards": ["tolerance"],
    "dm_control.utils.transformations": ["quat_mul", "euler_to_rmat"],
    "dm_control.utils.xml_tools": ["find_element"],
}


# Source of a package dm_control that is not Limberjack's.
GENUINE = {
    "__init__.py": "IS_GENUINE = True\n",
    "only_there.py": "",
    "suite/__init__.py": "IS_GENUINE = True\n",
    "suite/carousel.py": "",
}

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


def errors_of(*statements: str) -> list[tuple[str, str]]:
    """Type and message of the error that each statement raises, in one process, after the
    installation as dm_control.
    """
    program = f"""
    import json, sys
    {INSTALL}
    for statement in sys.argv[1:]:
        try:
            exec(statement, {{}})
        except Exception as error:
            print(json.dumps([type(error).__name__, str(error)]))
    """
    errors = [json.loads(line) for line in run(program, *statements).splitlines()]
    assert len(errors) == len(statements), f"not every statement raises: {errors}"
    return [(kind, message) for kind, message in errors]


@pytest.fixture
def genuine(tmp_path: Path) -> Path:
    """A folder with a package dm_control, for the front of the path."""
    for name, text in GENUINE.items():
        file = tmp_path / "dm_control" / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    return tmp_path


def test_the_installation_itself_imports_nothing_heavy() -> None:
    program = f"""
    import sys
    {INSTALL}
    heavy = ("mujoco", "dm_env", "limberjack.suite", "limberjack.utils.rewards")
    print([name for name in heavy if name in sys.modules])
    """
    assert run(program) == "[]\n"


def test_the_version_is_one_of_pep_440() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc|\.dev)\d+)?", limberjack.__version__)


@pytest.mark.parametrize("first", ["dm_control", "limberjack", "in turn"])
def test_every_module_is_one_object_under_both_names(first: str) -> None:
    program = f"""
    import importlib, json, pkgutil, sys
    {INSTALL}
    import dm_control
    assert dm_control is limberjack
    names = [m.name for m in pkgutil.walk_packages(limberjack.__path__, "limberjack.")]
    # Importing __main__ would run it.
    names = [name for name in names if not name.endswith("__main__")]
    names = [name for name in names if name not in json.loads(sys.argv[2])]
    for turn, name in enumerate(names):
        alias = name.replace("limberjack", "dm_control", 1)
        alias_first = turn % 2 if sys.argv[1] == "in turn" else sys.argv[1] == "dm_control"
        for asked in [alias, name] if alias_first else [name, alias]:
            module = importlib.import_module(asked)
            assert module.__name__ == module.__spec__.name == name, (asked, module.__spec__)
        assert sys.modules[alias] is sys.modules[name] is module
        parent, _, child = name.rpartition(".")
        assert getattr(sys.modules[parent], child) is module
    owners = {{}}
    for name, module in sys.modules.items():
        if getattr(module, "__file__", None) and name.startswith(("limberjack", "dm_control")):
            assert owners.setdefault(module.__file__, module) is module, name
    print(len(names))
    """
    assert int(run(program, first, json.dumps(list(MISSING)))) > 20


def test_all_names_that_programs_import_exist() -> None:
    program = f"""
    import importlib, json, sys
    {INSTALL}
    for name, attributes in json.loads(sys.argv[1]).items():
        module = importlib.import_module(name)
        for attribute in attributes:
            scope = {{}}
            exec(f"from {{name}} import {{attribute}} as it", scope)
            assert scope["it"] is getattr(module, attribute)
    """
    run(program, json.dumps(IMPORTED))


def test_all_forms_of_import_give_the_same_module() -> None:
    program = f"""
    import importlib, sys
    {INSTALL}
    import dm_control.suite.humanoid as first
    from dm_control.suite import humanoid as second
    from dm_control import suite
    import dm_control.suite
    import limberjack.suite.humanoid as third
    fourth = importlib.import_module("dm_control.suite.humanoid")
    fifth = importlib.import_module(".humanoid", "dm_control.suite")
    assert first is second is third is fourth is fifth is suite.humanoid
    assert dm_control.suite is suite
    assert sys.modules["dm_control.suite.humanoid"] is sys.modules["limberjack.suite.humanoid"]
    """
    run(program)


def test_modules_imported_before_the_installation_are_not_loaded_again() -> None:
    program = f"""
    import limberjack.suite.humanoid as before
    {INSTALL}
    import dm_control.suite.humanoid as after
    from dm_control.rl import control
    assert after is before
    assert isinstance(after.walk(), control.Environment)
    """
    run(program)


def test_pickles_name_limberjack_and_load_without_the_installation() -> None:
    write = f"""
    import pickle
    {INSTALL}
    from dm_control.suite import humanoid
    from dm_control.rl.control import PhysicsError
    print(pickle.dumps([humanoid.Physics, humanoid.walk, PhysicsError("x")], 0).decode())
    """
    text = run(write)
    assert "dm_control" not in text
    read = """
    import pickle, sys
    physics, walk, error = pickle.loads(sys.argv[1].encode())
    from limberjack.suite import humanoid
    assert physics is humanoid.Physics and walk is humanoid.walk
    """
    run(read, text)


def test_pickles_of_dm_control_load_here() -> None:
    program = f"""
    import pickle
    {INSTALL}
    physics = pickle.loads(b"cdm_control.suite.humanoid\\nPhysics\\n.")
    assert physics.__module__ == "limberjack.suite.humanoid"
    """
    run(program)


def test_searches_find_existing_modules_only() -> None:
    program = f"""
    import importlib.util, pkgutil, sys
    {INSTALL}
    find = importlib.util.find_spec
    assert find("dm_control").origin == limberjack.__file__
    spec = find("dm_control.suite")
    assert "limberjack.suite" not in sys.modules
    assert spec.origin.endswith("__init__.py") and list(spec.submodule_search_locations)
    import dm_control.suite
    assert find("dm_control.suite").origin == spec.origin == dm_control.suite.__file__
    assert find("dm_control.suite.humanoid") is not None
    assert find("dm_control.composer.anything") is not None
    assert find("dm_control.nothing") is None
    assert find("dm_control.suite.carousel") is None
    assert find("limberjack.nothing") is None
    assert find("dm_controller") is None
    names = {{module.name for module in pkgutil.iter_modules(dm_control.__path__)}}
    assert {{"mujoco", "rl", "suite", "utils"}} <= names, names
    walk = pkgutil.walk_packages(dm_control.suite.__path__, "dm_control.suite.")
    assert "dm_control.suite.utils.randomizers" in {{module.name for module in walk}}
    assert dm_control.suite.utils.__name__ == "limberjack.suite.utils"
    """
    run(program)


def test_threads_that_import_at_once_get_one_module() -> None:
    # Not limberjack.suite.humanoid and the like: Python itself reports a deadlock if threads
    # simultaneously import a package and a module that the package imports, for the first time.
    program = """
    import importlib, sys, threading
    import limberjack
    sys.setswitchinterval(1e-6)
    below = ["suite.humanoid", "suite.stacker", "suite.base", "mujoco.engine", "rl.control"]
    names = [f"dm_control.{name}" for name in below] * 2
    names += ["limberjack.suite", "limberjack.mujoco", "limberjack.rl", "dm_control.suite"]
    barrier, got, failed = threading.Barrier(len(names)), [], []
    def work(name):
        barrier.wait()
        try:
            limberjack.install_as_dm_control()
            got.append((name.partition(".")[2], importlib.import_module(name)))
        except BaseException as error:
            failed.append(error)
    threads = [threading.Thread(target=work, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed, failed
    for name, module in got:
        importlib.import_module(f"dm_control.{name}")
        assert module is sys.modules[f"limberjack.{name}"] is sys.modules[f"dm_control.{name}"]
        assert module.__spec__.name == f"limberjack.{name}"
    assert len(got) == len(names)
    ours = [f for f in sys.meta_path if type(f).__module__ == "limberjack._compat"]
    assert len(ours) == 2, sys.meta_path
    """
    run(program)


def test_installing_again_changes_nothing() -> None:
    program = f"""
    import sys
    {INSTALL}
    import dm_control.suite
    before = list(sys.meta_path), dict(sys.modules)
    limberjack.install_as_dm_control()
    assert (list(sys.meta_path), dict(sys.modules)) == before
    """
    run(program)


def test_installing_again_comes_before_finders_added_meanwhile() -> None:
    program = f"""
    import sys
    {INSTALL}
    class Finder:
        def find_spec(self, name, path=None, target=None):
            assert not name.startswith("dm_control"), name
    sys.meta_path.insert(0, Finder())
    sys.meta_path.append(Finder())
    count = len(sys.meta_path)
    limberjack.install_as_dm_control()
    import dm_control.suite
    assert len(sys.meta_path) == count
    """
    run(program)


def test_a_genuine_dm_control_on_the_path_is_never_reached(genuine: Path) -> None:
    program = f"""
    import importlib.util, sys
    {INSTALL}
    import dm_control, dm_control.suite
    assert dm_control is limberjack
    assert not hasattr(dm_control, "IS_GENUINE") and not hasattr(dm_control.suite, "IS_GENUINE")
    for name in ("dm_control.only_there", "dm_control.suite.carousel"):
        assert importlib.util.find_spec(name) is None
        try:
            __import__(name)
        except ModuleNotFoundError as error:
            assert error.name == name
        else:
            raise AssertionError(name)
    del sys.modules["dm_control"]
    import dm_control
    assert dm_control is limberjack
    """
    run(program, path=genuine)


def test_a_finder_of_an_editable_dm_control_is_never_asked(genuine: Path) -> None:
    program = f"""
    import importlib.util, sys
    from importlib.machinery import ModuleSpec
    class Finder:
        def find_spec(self, name, path=None, target=None):
            return ModuleSpec(name, None) if name.startswith("dm_control") else None
    sys.meta_path.insert(0, Finder())
    sys.meta_path.append(Finder())
    {INSTALL}
    for look in (__import__, importlib.util.find_spec):
        try:
            look("dm_control.suite.carousel")
        except ModuleNotFoundError:
            continue
        raise AssertionError(look)
    """
    run(program)


def test_a_genuine_dm_control_that_is_imported_is_refused_and_left_alone(genuine: Path) -> None:
    program = """
    import sys
    import dm_control.suite
    import limberjack, limberjack._compat
    before = list(sys.meta_path), dict(sys.modules)
    for _ in range(2):
        try:
            limberjack.install_as_dm_control()
        except RuntimeError as error:
            print(error)
    assert (list(sys.meta_path), dict(sys.modules)) == before
    import dm_control.suite.carousel
    """
    first, second = run(program, path=genuine).splitlines()
    assert first == second
    assert str(genuine) in first
    assert "before anything imports dm_control" in first


def test_an_alias_made_by_hand_that_loaded_copies_is_refused() -> None:
    program = """
    import sys
    import limberjack
    sys.modules["dm_control"] = limberjack
    import dm_control.utils.rewards
    try:
        limberjack.install_as_dm_control()
    except RuntimeError as error:
        print(error)
    """
    assert "dm_control is already imported" in run(program)


def test_a_blocked_import_is_unblocked() -> None:
    program = f"""
    import sys
    sys.modules["dm_control"] = None
    {INSTALL}
    from dm_control import utils
    """
    run(program)


def test_a_domain_that_does_not_exist_is_an_import_error_that_lists_the_domains() -> None:
    statements = (
        "from dm_control.suite import carousel",
        "import dm_control.suite.carousel",
        "from dm_control.suite.carousel import Physics",
        "import limberjack.suite.carousel",
    )
    for kind, message in errors_of(*statements):
        assert kind == "ModuleNotFoundError"
        assert "'suite.carousel'" in message
        assert "Available domains: acrobot, ball_in_cup, cartpole," in message
        assert "install dm_control itself" in message


def test_an_unknown_name_brings_a_suggestion() -> None:
    *attributes, (_, humanoid), (_, nothing) = errors_of(
        "from dm_control.utils import reward",
        "import dm_control.utils.reward",
        "from dm_control.suite import humanoidd",
        "from dm_control import nothing",
    )
    for kind, message in attributes:
        assert kind == "ModuleNotFoundError"
        assert "Did you mean 'rewards'?" in message
    assert "Did you mean 'humanoid'?" in humanoid
    assert "No module named 'limberjack.nothing'" in nothing


def test_a_missing_module_is_caught_as_an_import_error() -> None:
    program = f"""
    {INSTALL}
    try:
        from dm_control.suite import dog
    except ImportError:
        dog = None
    from dm_control.suite import *
    """
    run(program)


def test_an_error_inside_a_module_is_the_modules_own(tmp_path: Path) -> None:
    program = f"""
    import sys
    {INSTALL}
    limberjack.__path__.append(sys.argv[1])
    for _ in range(2):
        try:
            import dm_control.broken
        except ImportError as error:
            print(error)
    assert not any("broken" in name for name in sys.modules)
    """
    (tmp_path / "broken.py").write_text("raise ImportError('install the extra')")
    assert run(program, str(tmp_path)) == "install the extra\n" * 2


def test_a_forked_process_has_the_installation_and_a_spawned_one_has_not(tmp_path: Path) -> None:
    (tmp_path / "looking.py").write_text(
        "import sys\ndef look(_):\n    return 'dm_control' in sys.modules\n"
    )
    program = f"""
    import multiprocessing
    from looking import look
    {INSTALL}
    for method in ("fork", "spawn"):
        if method in multiprocessing.get_all_start_methods():
            with multiprocessing.get_context(method).Pool(1) as pool:
                assert pool.map(look, [0]) == [method == "fork"], method
    """
    run(program, path=tmp_path)


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
    class Mine(composer.Task):  # as programs define beside tasks of the suite
        pass
    from dm_control.manipulation.shared import workspaces
    box = workspaces.BoundingBox(lower=(-0.1, 0), upper=(0.1, 1))
    assert (box.lower, box.upper) == ((-0.1, 0), (0.1, 1))
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
    "type(composer.Task)('Mine', (composer.Task,), {})()",
    "exec('class Mine(composer.Task): pass\\nMine()')",
    "exec('import abc\\nclass Mine(composer.Task, abc.ABC): pass\\nMine(1, x=2)')",
    "exec('class Mine(composer.SomeError): pass\\nMine()')",
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
