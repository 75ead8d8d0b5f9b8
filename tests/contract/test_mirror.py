"""The tests mirror the source: the tests of a/b.py are tests/a/test_b.py."""

import ast
from pathlib import Path

from .source import PACKAGE, REPOSITORY, SOURCE, modules, tree

_TESTS = REPOSITORY / "tests"
# Modules without tests under their name, and why.
_EXCEPTIONS = {
    "data.py": "the public names of datasets, which tests/episodes uses",
    "__main__.py": "one line, which every command that is called as a program runs",
    "sb3.py": "the public names of adapters/sb3.py",
    "mujoco/rendering/egl.py": "a backend, which rendering/test_backends.py chooses",
    "mujoco/wrapper/mjbindings/constants.py": "tested in wrapper/test_mjbindings.py",
    "mujoco/wrapper/mjbindings/enums.py": "tested in wrapper/test_mjbindings.py",
    "mujoco/wrapper/mjbindings/functions.py": "tested in wrapper/test_mjbindings.py",
}
# Folders of tests that mirror no part of the package; tests/__init__.py says what they are.
_BESIDES = {
    "benchmarks", "browser", "clients", "contract", "docs", "exactness", "examples", "laws",
    "oracle", "tools",
}  # fmt: skip
# Modules in a mirroring folder that test more than one module.
_ACROSS = {
    "episodes/test_own_environments.py",
    "episodes/test_pictures.py",
    "episodes/test_readers.py",
    "evaluation/test_experiment_workers.py",
    "evaluation/test_saved_models.py",
    "gpu/test_exactness.py",
    "gym/test_env_kinds.py",
    "gym/test_pixels.py",
    "gym/test_registration.py",
    "mujoco/test_camera_beside_dm_control.py",
    "mujoco/test_live_attributes.py",
    "planner/test_costs.py",
    "planner/test_planner_benchmark.py",
    "planner/test_sleep.py",
    "rl/test_action_repeat.py",
    "rl/test_users_tasks.py",
    "rl/test_batch_rendering.py",
    "rl/test_batch_time_steps.py",
    "rl/test_row_time_steps.py",
    "suite/test_suite.py",
    "test_plain_domain.py",
    "test_tutorial_package.py",
}


def _only_exports(module: str) -> bool:
    """Whether a package's `__init__` has nothing but imports, names and a docstring."""
    harmless = (ast.Import, ast.ImportFrom, ast.Assign, ast.AnnAssign, ast.Expr, ast.If, ast.Try)
    return all(isinstance(node, harmless) for node in tree(module).body)


def _test_of(path: Path) -> Path:
    """The path below tests/ of the tests of a module."""
    folder = Path(*(part.lstrip("_") for part in path.parts[:-1]))
    return folder / f"test_{path.name.lstrip('_')}"


def _paths(of_packages: bool) -> dict[Path, str]:
    """Names of modules or packages to mirror, by path below the package."""
    found = {}
    for name, path in modules().items():
        below = path.relative_to(SOURCE / PACKAGE)
        is_package = below.name == "__init__.py"
        if is_package is of_packages and below.parts[0] != "__init__.py":
            found[below.parent.with_suffix(".py") if is_package else below] = name
    return found


def test_every_module_has_tests_under_its_name() -> None:
    lacking = [
        f"{path}: expected tests/{_test_of(path)}"
        for path in _paths(of_packages=False)
        if str(path) not in _EXCEPTIONS and not (_TESTS / _test_of(path)).exists()
    ]
    assert not lacking, "\n".join(["write them, or give a reason in _EXCEPTIONS:", *lacking])


def test_every_package_that_defines_something_has_tests() -> None:
    for path, name in _paths(of_packages=True).items():
        if _only_exports(name):
            continue
        test = _test_of(path)
        within = list((_TESTS / test.parent / path.stem.lstrip("_")).glob("test_*.py"))
        assert within or (_TESTS / test).exists(), f"{name}: expected tests/{test}"


def test_every_module_of_tests_has_a_module_that_it_tests() -> None:
    mirrored = {_test_of(path) for kind in (True, False) for path in _paths(of_packages=kind)}
    tests = {path.relative_to(_TESTS) for path in _TESTS.rglob("test_*.py")}
    astray = [
        str(path)
        for path in sorted(tests - mirrored)
        if path.parts[0] not in _BESIDES and str(path) not in _ACROSS
    ]
    assert not astray, f"rename {astray} after the modules that they test, or list them in _ACROSS"


def test_the_exceptions_are_needed() -> None:
    paths = {str(path) for path in _paths(of_packages=False)}
    assert set(_EXCEPTIONS) <= paths, "an exception for a module that does not exist"
    for path in _EXCEPTIONS:
        assert not (_TESTS / _test_of(Path(path))).exists(), f"{path} has tests now"
    mirrored = {str(_test_of(path)) for kind in (True, False) for path in _paths(of_packages=kind)}
    for path in _ACROSS:
        assert (_TESTS / path).exists(), path
        assert path not in mirrored, f"{path} mirrors a module: it needs no exception"
