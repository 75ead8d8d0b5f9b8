"""Every file is written through `limberjack.utils.files`: exclusively, and never through a link."""

import ast
from collections.abc import Iterator

from .source import modules, tree

_WRITER = "limberjack.utils.files"
# Calls that write to a path, or give a file another one.
_BY_RECEIVER = {"write_text", "write_bytes", "symlink_to", "hardlink_to"}
_BY_ARGUMENT = {
    "savez",
    "savez_compressed",
    "savetxt",
    "tofile",
    "savefig",
    "imwrite",
    "imsave",
    "mimwrite",
    "write_table",
    "write_parquet",
    "ParquetWriter",
    "ZipFile",
}
_BY_FULL_NAME = {
    "np.save",
    "os.link",
    "os.mkfifo",
    "os.open",
    "os.rename",
    "os.replace",
    "os.symlink",
    "shutil.copy",
    "shutil.copy2",
    "shutil.copyfile",
    "shutil.move",
    "tempfile.NamedTemporaryFile",
    "tempfile.mkstemp",
    "tempfile.mktemp",
}
# Calls that write no file of a user, each with the reason.
_OTHERS = {
    ("limberjack.workers.process", "open"),  # a value of the kernel's, in /proc
    ("limberjack.utils.io", "open"),  # dm_control's function, whose caller chooses the mode
    # Into memory, or a file that `limberjack.episodes.writing` has made with `filling`.
    ("limberjack.episodes.parquet", "pq.ParquetWriter"),
    ("limberjack.episodes.parquet", "writer.write_table"),
    ("limberjack.episodes.parquet", "file.open"),
    ("limberjack.episodes.writing", "partial.write_bytes"),
    ("limberjack.episodes.folder", "partial.write_text"),
    ("limberjack.episodes.remote", "files.open"),  # for reading; fsspec takes the mode second
    ("limberjack.worlds.appearance.media", "Image.open"),  # for reading; it takes the file first
    # Into a folder that `limberjack.episodes.converting` makes; so does `write_plain` above.
    ("limberjack.episodes.to_lerobot", "(folder / name).write_text"),
    ("limberjack.adapters.sb3", "zipfile.ZipFile"),
}


def _names_of_partial_files(node: ast.AST) -> set[str]:
    """Variables that `with replacing(...) as name`, or `filling`, binds in a module."""
    return {
        item.optional_vars.id
        for one in ast.walk(node)
        if isinstance(one, ast.With)
        for item in one.items
        if isinstance(item.context_expr, ast.Call)
        and ast.unparse(item.context_expr.func).endswith(("replacing", "filling"))
        and isinstance(item.optional_vars, ast.Name)
    }


def _writes(call: ast.Call) -> ast.expr | None:
    """The target of a call that may write to a file; None for other calls."""
    name = ast.unparse(call.func)
    last = name.rpartition(".")[2]
    if last in _BY_RECEIVER and isinstance(call.func, ast.Attribute):
        return call.func.value
    if last in _BY_ARGUMENT and call.args:
        return call.args[0]
    if name in _BY_FULL_NAME:
        return call.func
    if last == "open" and name not in ("scale.open", "self.scale.open", "archive.open"):
        own = 1 if name in ("open", "io.open") else 0
        modes = [*call.args[own : own + 1], *(k.value for k in call.keywords if k.arg == "mode")]
        if not modes:
            return None
        if isinstance(modes[0], ast.Constant) and not set(str(modes[0].value)) & set("wax+"):
            return None
        return call.func.value if isinstance(call.func, ast.Attribute) else call.func
    return None


def _writers(module: str, node: ast.AST) -> Iterator[str]:
    partial = _names_of_partial_files(node)
    for call in ast.walk(node):
        if not isinstance(call, ast.Call):
            continue
        target = _writes(call)
        name = ast.unparse(call.func)
        if target is None or (isinstance(target, ast.Name) and target.id in partial):
            continue
        if (module, name) not in _OTHERS:
            yield f"{module}:{call.lineno} {name}"


def test_no_other_module_writes_files() -> None:
    found = [
        one for module in modules() if module != _WRITER for one in _writers(module, tree(module))
    ]
    assert found == []


def test_writers_are_found_wherever_they_are_hidden() -> None:
    for text in (
        "path.write_text('')",
        "(folder / 'name').write_bytes(b'')",
        "open(path, 'w')",
        "open(path, mode='ab')",
        "path.open('x')",
        "path.open(mode)",
        "os.open(path, flags)",
        "np.savez(path, a=a)",
        "figure.savefig(path)",
        "tempfile.NamedTemporaryFile()",
    ):
        assert list(_writers("somewhere", ast.parse(text))), text
    for text in (
        "with replacing(path) as partial:\n    partial.write_text('')",
        "with Hold(a), replacing(path) as partial:\n    np.savez(partial, a=a)",
        "with replacing(path) as partial, partial.open('wb') as file:\n    file.write(b'')",
        "open(path)",
        "path.open('rb')",
    ):
        assert not list(_writers("somewhere", ast.parse(text))), text
