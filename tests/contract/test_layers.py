"""The structure of the source: layers, heavy imports, sizes and `__all__`."""

import ast
import graphlib
import importlib
import importlib.util
import itertools
import subprocess
import sys
from types import ModuleType

import pytest

from limberjack.utils.requirements import missing_extra

from .extras import MADE_OF, MISSING
from .source import PACKAGE, imports, is_public, modules, tree

# Imports point down, or stay level. The longest name that a module begins with counts.
_LAYERS = {
    "limberjack._compat": 0,
    "limberjack._gymnasium_plugin": 0,
    "limberjack.registry": 0,
    "limberjack.utils": 0,
    "limberjack.rl": 1,
    "limberjack.mujoco": 2,
    "limberjack.rl.batch": 3,
    "limberjack.rl.batch_measurements": 3,
    "limberjack.rl.batch_safety": 3,
    "limberjack.rl.batch_test_utils": 3,
    "limberjack.suite": 4,
    "limberjack.bench": 5,
    "limberjack.data": 5,
    "limberjack.doctor": 5,
    "limberjack.evaluation": 5,
    "limberjack.factories": 5,
    "limberjack.gallery": 5,
    "limberjack.gpu": 5,
    "limberjack.gym": 5,
    "limberjack.notebook": 5,
    "limberjack.planner": 5,
    "limberjack.policies": 5,
    "limberjack.recording": 5,
    "limberjack.report": 5,
    "limberjack.rollout": 5,
    "limberjack.sb3": 5,
    "limberjack.video": 5,
    "limberjack.viewer": 5,
    "limberjack.workers": 5,
    "limberjack.cli": 6,
    "limberjack.__main__": 6,
}

_EVERYWHERE = {"dm_env", "mujoco", "numpy"}
# Everything else that is installed is imported by one module, or one package, only.
_ONLY_IN: dict[str, str | tuple[str, ...]] = {
    "dm_control": "limberjack.doctor.probes",
    "gymnasium": ("limberjack.gym", "limberjack.gpu.vector"),  # each has a class of its own for it
    "glfw": "limberjack.mujoco.rendering.backends",
    "imageio_ffmpeg": "limberjack.video",
    "matplotlib": "limberjack.report.curve",
    "minari": "limberjack.data.to_minari",
    "pyarrow": "limberjack.data.parquet",
    "ray": "limberjack.workers.ray_tasks",
    "mujoco_warp": "limberjack.gpu.backend",
    "rich": "limberjack.cli",
    "rsl_rl": "limberjack.gpu.rsl_rl",
    "stable_baselines3": "limberjack.sb3",
    "tensordict": "limberjack.gpu.rsl_rl",
    "torch": "limberjack.gpu.backend",
    "typer": "limberjack.cli",
    "warp": "limberjack.gpu.backend",
    "websockets": "limberjack.viewer.guard",  # for its types only: Studio imports it
}
# Modules that one folder uses and that lie outside it: dm_control's paths, and what users import.
_STANDS_ALONE = (
    "limberjack.suite.utils.randomizers",
    "limberjack.utils.containers",
    "limberjack.utils.rewards",
    "limberjack.utils.xml_tools",
    "limberjack.data.to_minari",
    "limberjack.gallery",
    "limberjack.gym.specs",  # of Gymnasium's own, for what converts to its formats
    "limberjack.gpu.speed",
    "limberjack.notebook",
    "limberjack.planner.arm.roadmap",
    "limberjack.planner.solving",
    "limberjack.recording.episodes",
    "limberjack.recording.films",
    "limberjack.sb3",
)

_MAX_FILE_LINES = 400
_MAX_FUNCTION_LINES = 40  # without the docstring

_ALL = sorted(modules())
_PUBLIC = [module for module in _ALL if is_public(module)]
_Function = ast.FunctionDef | ast.AsyncFunctionDef


def _layer(module: str) -> int | None:
    prefixes = [name for name in _LAYERS if f"{module}.".startswith(f"{name}.")]
    return _LAYERS[max(prefixes, key=len)] if prefixes else None


def _own_imports(module: str) -> set[str]:
    """Modules of the package that a module imports, except for the root, which has the version."""
    return {name for name in imports(module) if name in modules()} - {PACKAGE, module}


def _folder(module: str) -> str:
    """The folder of a module; a module beside the folders is one by itself."""
    path = modules()[module]
    return str(path if path.parent.name == PACKAGE else path.parent)


def _imported(module: str) -> ModuleType:
    if module in MISSING:
        pytest.skip("needs the extra {1!r}: {0} is not installed".format(*MISSING[module]))
    return importlib.import_module(module)


def _is_definition(node: ast.stmt) -> bool:
    return isinstance(node, _Function | ast.ClassDef | ast.Assign | ast.AnnAssign)


def _defined_names(node: ast.stmt) -> list[str]:
    if isinstance(node, _Function | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return [name.id for target in targets if target for name in ast.walk(target)
            if isinstance(name, ast.Name)]  # fmt: skip


@pytest.mark.parametrize("module", [name for name in _ALL if name != PACKAGE])
def test_imports_point_down(module: str) -> None:
    layer = _layer(module)
    assert layer is not None, f"{module} has no layer: give it one in {__file__}"
    for imported in sorted(_own_imports(module)):
        below = _layer(imported)
        assert below is not None, f"{imported} has no layer"
        assert below <= layer, f"{module} (layer {layer}) imports {imported} (layer {below})"


def test_a_module_that_one_folder_uses_lies_in_that_folder() -> None:
    users: dict[str, set[str]] = {module: set() for module in _ALL}
    for module in _ALL:
        for imported in _own_imports(module):
            users[imported].add(_folder(module))
    astray = [
        module
        for module, folders in users.items()
        if len(folders) == 1 and _folder(module) not in folders and module not in _STANDS_ALONE
        if modules()[module].name != "__init__.py"
    ]
    assert not astray, "move these, or name them in _STANDS_ALONE"


def _packages_of(module: str) -> set[str]:
    """The packages that a module lies in, except for the root."""
    parts = module.split(".")
    return {".".join(parts[:count]) for count in range(2, len(parts))}


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {}
    for module in set(_ALL) - {PACKAGE}:
        imported = _own_imports(module)
        # The packages of what is imported are imported as well, if they have not been.
        around = set().union(*map(_packages_of, imported)) - _packages_of(module)
        graph[module] = (imported | around) - {module}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_every_package_can_be_the_first_one_imported() -> None:
    # Then each module of it can too: its package comes before it, and there are no circles.
    packages = {module for module in _PUBLIC if modules()[module].name == "__init__.py"}
    code = f"""
import importlib, sys
for name in {sorted(packages - set(MISSING))!r}:
    for loaded in [m for m in sys.modules if m.partition(".")[0] == {PACKAGE!r}]:
        del sys.modules[loaded]
    importlib.import_module(name)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("module", MADE_OF)
def test_without_its_extra_a_module_names_the_packages_to_install(module: str) -> None:
    package, extra = MADE_OF[module]
    code = f"import sys; sys.modules[{package!r}] = None; from {module} import *"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert f"ImportError: {missing_extra(extra)}" in done.stderr


def test_the_package_itself_imports_only_the_registration_of_ids() -> None:
    program = """
import sys
import gymnasium
before = set(sys.modules)
import limberjack
new = set(sys.modules) - before
print(sorted(m for m in new if m.partition(".")[0] not in sys.stdlib_module_names))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    loaded = ast.literal_eval(done.stdout)
    allowed = ("limberjack", "limberjack.gym", "limberjack.registry")
    assert [m for m in loaded if m not in allowed and not m.startswith(f"{allowed[-1]}.")] == []
    assert set(allowed) <= set(loaded)


@pytest.mark.parametrize("module", _ALL)
def test_heavy_packages_are_imported_in_one_place(module: str) -> None:
    for name in imports(module):
        root = name.partition(".")[0]
        if root in _EVERYWHERE or root == PACKAGE or root in sys.stdlib_module_names:
            continue
        assert root in _ONLY_IN, f"{module} imports {root}: say in {__file__} that it may"
        places = _ONLY_IN[root]
        places = (places,) if isinstance(places, str) else places
        allowed = any(f"{module}.".startswith(f"{place}.") for place in places)
        assert allowed, f"{module} imports {root}; only {' and '.join(places)} may"


def test_only_one_module_imports_studio() -> None:
    found = {m for m in _ALL if any(name.startswith("mujoco.studio") for name in imports(m))}
    assert found == {"limberjack.viewer.studio"}


def test_the_lists_above_name_modules_that_exist() -> None:
    places = [(each,) if isinstance(each, str) else each for each in _ONLY_IN.values()]
    assert {*itertools.chain(*places), *MADE_OF} <= set(_ALL)


@pytest.mark.parametrize("module", _ALL)
def test_files_are_short(module: str) -> None:
    count = len(modules()[module].read_text(encoding="utf-8").splitlines())
    assert count <= _MAX_FILE_LINES, f"{module} has {count} lines"


@pytest.mark.parametrize("module", _ALL)
def test_functions_are_short(module: str) -> None:
    for node in ast.walk(tree(module)):
        if not isinstance(node, _Function):
            continue
        first = node.body[0]
        docstring = ast.get_docstring(node, clean=False)
        text = 0 if docstring is None else (first.end_lineno or 0) - first.lineno + 1
        count = (node.end_lineno or 0) - node.lineno + 1 - text
        assert count <= _MAX_FUNCTION_LINES, f"{module}.{node.name} has {count} lines"


@pytest.mark.parametrize("module", _ALL)
def test_every_module_has_a_docstring(module: str) -> None:
    assert ast.get_docstring(tree(module)), f"{module} has no docstring"


@pytest.mark.parametrize("module", _ALL)
def test_every_public_function_and_class_has_a_docstring(module: str) -> None:
    for node in tree(module).body:
        if isinstance(node, _Function | ast.ClassDef) and not node.name.startswith("_"):
            if any(ast.unparse(decorator) == "overload" for decorator in node.decorator_list):
                continue  # a signature for type checkers, of a function that has one
            assert ast.get_docstring(node), f"{module}.{node.name} has no docstring"


@pytest.mark.parametrize("module", _PUBLIC)
def test_all_names_exist(module: str) -> None:
    loaded = _imported(module)
    names = getattr(loaded, "__all__", [])
    assert sorted(set(names)) == sorted(names), "a name stands twice"
    for name in names:
        assert hasattr(loaded, name), f"{module}.__all__ names {name}, which is not there"


@pytest.mark.parametrize("module", _PUBLIC)
def test_all_has_every_public_definition(module: str) -> None:
    defined = {
        name
        for node in tree(module).body
        if _is_definition(node)
        for name in _defined_names(node)
        if not name.startswith("_")
    }
    if not defined:
        return  # a package that only holds modules need not say so
    named = set(getattr(_imported(module), "__all__", ()))
    assert defined <= named, f"{module}.__all__ lacks {sorted(defined - named)}"
