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

# A floor imports from floors under it, and from its own room. The longest name that a module begins
# with counts.
_FLOORS = {
    "limberjack._compat": 0,
    "limberjack._gymnasium_plugin": 0,
    "limberjack.registry": 0,
    "limberjack.utils": 0,
    "limberjack.worlds": 0,
    "limberjack.rl": 1,
    "limberjack.mujoco": 2,
    "limberjack.utils.inverse_kinematics": 3,  # at dm_control's path; it searches with a Physics
    "limberjack.rl.batch": 3,
    "limberjack.rl.batch_safety": 3,
    "limberjack.rl.batch_test_utils": 3,
    "limberjack.rl.batches": 3,
    "limberjack.rl.builds": 3,
    "limberjack.rl.episode_attributes": 3,
    "limberjack.rl.late_changes": 3,
    "limberjack.rl.row_trial": 3,
    "limberjack.rl.rows": 3,
    "limberjack.rl.watch": 3,
    "limberjack.suite": 4,
    "limberjack.gym": 5,
    "limberjack.gpu": 6,
    "limberjack.adapters": 7,
    "limberjack.planner": 7,
    "limberjack.sb3": 7,
    "limberjack.policies": 8,
    "limberjack.see": 9,
    "limberjack.viewer": 9,
    "limberjack.workers": 9,
    "limberjack.data": 10,
    "limberjack.episodes": 10,
    "limberjack.evaluation": 11,
    "limberjack.gallery": 11,
    "limberjack.training": 11,
    "limberjack.bench": 12,
    "limberjack.doctor": 13,
    "limberjack.cli": 14,
    "limberjack.__main__": 15,
}
# Rooms of several names; each other name is a room by itself.
_ROOMS = {
    "limberjack._compat": "foundations",
    "limberjack._gymnasium_plugin": "foundations",
    "limberjack.registry": "foundations",
    "limberjack.utils": "foundations",
    "limberjack.worlds": "foundations",
    "limberjack.data": "limberjack.episodes",
    "limberjack.sb3": "limberjack.adapters",
}

_EVERYWHERE = {"dm_env", "mujoco", "numpy"}
# Everything else that is installed is imported by one module, or one package, only.
_ONLY_IN: dict[str, str | tuple[str, ...]] = {
    "dm_control": "limberjack.doctor.probes",
    "PIL": "limberjack.worlds.appearance.media",
    "envpool": "limberjack.bench.columns",  # which is stepped beside this package
    "flax": "limberjack.training.learner",
    "fsspec": "limberjack.episodes.remote",
    "gymnasium": ("limberjack.gym", "limberjack.gpu.vector"),  # each has a class of its own for it
    "glfw": "limberjack.mujoco.rendering.backends",
    "jax": "limberjack.training.learner",
    "imageio_ffmpeg": "limberjack.utils.ffmpeg",
    "matplotlib": "limberjack.see.report.curve",
    "minari": "limberjack.episodes.to_minari",
    "google": "limberjack.policies.onnx_models",  # protobuf, in which models are written
    "onnx": "limberjack.policies.onnx_models",
    "onnxruntime": "limberjack.policies.onnx",
    "pyarrow": "limberjack.episodes.parquet",
    "ray": "limberjack.workers.ray_tasks",
    "mujoco_warp": "limberjack.gpu.backend",
    "rich": "limberjack.cli",
    "rsl_rl": "limberjack.adapters.rsl_rl",
    "safetensors": "limberjack.policies.mlp",
    "threadpoolctl": "limberjack.policies.mlp",
    "sbx": "limberjack.training.learner",
    "stable_baselines3": ("limberjack.adapters.sb3", "limberjack.training.learner"),
    "tensorboard": "limberjack.training.learner",
    "tensordict": "limberjack.adapters.rsl_rl",
    "torch": ("limberjack.episodes.torch_datasets", "limberjack.gpu.backend"),
    "typer": "limberjack.cli",
    "warp": "limberjack.gpu.backend",
    "websockets": "limberjack.viewer.guard",  # for its types only: Studio imports it
}
# Modules that one folder uses and that lie outside it: dm_control's paths, and what users import.
_STANDS_ALONE = (
    "limberjack._compat",
    "limberjack.mujoco.math",
    "limberjack.suite.utils.parse_amc",
    "limberjack.suite.utils.randomizers",
    "limberjack.utils.containers",
    "limberjack.data",
    "limberjack.doctor.exactness",  # for a Python user too
    "limberjack.episodes.replaying",
    "limberjack.episodes.running",
    "limberjack.utils.inverse_kinematics",
    "limberjack.utils.rewards",
    "limberjack.utils.transformations",
    "limberjack.utils.xml_tools",
    "limberjack.episodes.to_lerobot",
    "limberjack.episodes.to_minari",
    "limberjack.gallery",
    "limberjack.gym.made",  # of Gymnasium's own, for what converts to its formats
    "limberjack.gpu.speed",
    "limberjack.planner.arm.roadmap",
    "limberjack.planner.optimisers.icem",  # for settings of users; no cost of the suite's has it
    "limberjack.episodes.films",
    "limberjack.adapters.sb3",
    "limberjack.see.notebook",
    "limberjack.sb3",
    "limberjack.policies.exporting",  # which a Python user calls too
)

_MAX_FILE_LINES = 600
_MAX_FUNCTION_LINES = 40  # without the signature and the docstring

_ALL = sorted(modules())
_PUBLIC = [module for module in _ALL if is_public(module)]
_Function = ast.FunctionDef | ast.AsyncFunctionDef


def _name(module: str) -> str | None:
    """The name in _FLOORS that a module belongs to."""
    prefixes = [name for name in _FLOORS if f"{module}.".startswith(f"{name}.")]
    return max(prefixes, key=len) if prefixes else None


def _may_use(module: str, imported: str) -> bool:
    """Whether a module may import another one of the package."""
    user, used = _name(module), _name(imported)
    assert user is not None
    assert used is not None
    rooms = [_ROOMS.get(name, name) for name in (user, used)]
    level = (
        _FLOORS[user] == _FLOORS[used] and rooms[0].split(".rl.")[0] == rooms[1].split(".rl.")[0]
    )
    return level or _FLOORS[used] < _FLOORS[user]


def _own_imports(module: str) -> set[str]:
    """Modules of the package that a module imports, except for the root, which has the version.

    Those that a package offers under its own name, imported on first use, do not count.
    """
    offered = {"limberjack.rl.batches"} if module == "limberjack.rl" else set()
    return {name for name in imports(module) if name in modules()} - {PACKAGE, module} - offered


def _folder(module: str) -> str:
    """The folder of a module; a module beside the folders is one by itself."""
    path = modules()[module]
    return str(path if path.parent.name == PACKAGE else path.parent)


def _by_extra() -> dict[str, list[str]]:
    """The public modules that can be imported, and those of each extra that is not installed."""
    found: dict[str, list[str]] = {}
    for module in _PUBLIC:
        _, extra = MISSING.get(module, ("", "installed"))
        found.setdefault(extra, []).append(module)
    return found


every_extra = pytest.mark.parametrize(("extra", "public"), _by_extra().items())


def _imported(public: list[str]) -> dict[str, ModuleType]:
    for module in public:
        if module in MISSING:
            pytest.skip("needs the extra {1!r}: {0} is not installed".format(*MISSING[module]))
    return {module: importlib.import_module(module) for module in public}


def _is_definition(node: ast.stmt) -> bool:
    return isinstance(node, _Function | ast.ClassDef | ast.Assign | ast.AnnAssign)


def _defined_names(node: ast.stmt) -> list[str]:
    if isinstance(node, _Function | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return [name.id for target in targets if target for name in ast.walk(target)
            if isinstance(name, ast.Name)]  # fmt: skip


def test_every_module_has_a_floor() -> None:
    lacking = [module for module in _ALL if module != PACKAGE and _name(module) is None]
    assert not lacking, f"give these a floor in {__file__}"


def test_imports_point_down() -> None:
    upwards = [
        f"{module} imports {imported}"
        for module in _ALL
        if module != PACKAGE
        for imported in sorted(_own_imports(module))
        if not _may_use(module, imported)
    ]
    assert not upwards


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


def test_without_its_extra_a_module_names_the_packages_to_install() -> None:
    expected = {module: str(missing_extra(extra)) for module, (_, extra) in MADE_OF.items()}
    code = f"""
import sys
found = {{}}
for module, (package, _) in {MADE_OF!r}.items():
    roots = ({PACKAGE!r}, package)
    hidden = {{m: sys.modules.pop(m) for m in list(sys.modules) if m.partition(".")[0] in roots}}
    sys.modules[package] = None
    try:
        exec(f"from {{module}} import *")
    except ImportError as error:
        found[module] = str(error)
    sys.modules.pop(package)
    sys.modules.update(hidden)
print(found)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert ast.literal_eval(done.stdout) == expected


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


def _may_import(module: str, root: str) -> bool:
    """Whether a module may import a package that is installed."""
    if root in _EVERYWHERE or root == PACKAGE or root in sys.stdlib_module_names:
        return True
    places = _ONLY_IN.get(root, ())
    places = (places,) if isinstance(places, str) else places
    return any(f"{module}.".startswith(f"{place}.") for place in places)


def test_heavy_packages_are_imported_in_one_place() -> None:
    found = [
        f"{module} imports {root}; only {_ONLY_IN.get(root, 'what _ONLY_IN names')} may"
        for module in _ALL
        for root in sorted({name.partition(".")[0] for name in imports(module)})
        if not _may_import(module, root)
    ]
    assert not found


def test_only_one_module_imports_studio() -> None:
    found = {m for m in _ALL if any(name.startswith("mujoco.studio") for name in imports(m))}
    assert found == {"limberjack.viewer.studio"}


def test_the_lists_above_name_modules_that_exist() -> None:
    places = [(each,) if isinstance(each, str) else each for each in _ONLY_IN.values()]
    assert {*itertools.chain(*places), *MADE_OF} <= set(_ALL)


def test_long_files_say_why_they_are_one_idea() -> None:
    long = {
        module: ast.get_docstring(tree(module)) or ""
        for module, path in modules().items()
        if len(path.read_text(encoding="utf-8").splitlines()) > _MAX_FILE_LINES
    }
    assert not [module for module, text in long.items() if "one idea" not in text], "lines"


def _lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """The number of lines of a function without its signature and docstring."""
    first = function.body[0]
    docstring = ast.get_docstring(function, clean=False)
    text = 0 if docstring is None else (first.end_lineno or 0) - first.lineno + 1
    return (function.end_lineno or 0) - first.lineno + 1 - text


def test_functions_are_short() -> None:
    functions = [
        (module, node)
        for module in _ALL
        for node in ast.walk(tree(module))
        if isinstance(node, _Function)
    ]
    long = [
        f"{module}.{node.name}" for module, node in functions if _lines(node) > _MAX_FUNCTION_LINES
    ]
    assert not long, f"these have more than {_MAX_FUNCTION_LINES} lines"


def test_every_module_has_a_docstring() -> None:
    assert not [module for module in _ALL if not ast.get_docstring(tree(module))]


def _needs_a_docstring(node: ast.stmt) -> bool:
    if not isinstance(node, _Function | ast.ClassDef) or node.name.startswith("_"):
        return False
    # An overload is a signature for type checkers, of a function that has a docstring.
    return not any(ast.unparse(decorator) == "overload" for decorator in node.decorator_list)


def test_every_public_function_and_class_has_a_docstring() -> None:
    lacking = [
        f"{module}, line {node.lineno}"
        for module in _ALL
        for node in tree(module).body
        if _needs_a_docstring(node) and not ast.get_docstring(node)  # pyright: ignore
    ]
    assert not lacking


@every_extra
def test_all_names_exist(extra: str, public: list[str]) -> None:
    for module, loaded in _imported(public).items():
        names = getattr(loaded, "__all__", [])
        assert sorted(set(names)) == sorted(names), f"a name stands twice in {module}.__all__"
        lacking = [name for name in names if not hasattr(loaded, name)]
        assert not lacking, f"{module}.__all__ names what is not there"


@every_extra
def test_all_has_every_public_definition(extra: str, public: list[str]) -> None:
    for module, loaded in _imported(public).items():
        defined = {
            name
            for node in tree(module).body
            if _is_definition(node)
            for name in _defined_names(node)
            if not name.startswith("_")
        }
        # A package that only holds modules defines nothing, and need not say so.
        lacking = defined - set(getattr(loaded, "__all__", ()))
        assert not lacking, f"{module}.__all__ lacks {sorted(lacking)}"
