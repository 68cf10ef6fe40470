"""The house plan: which room may import which, what stands at the top level, what is documented."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from rooms import ROOT, Arrow, arrows, every_arrow, imports, only_for_types, source_files

MATERIALS = {"core", "directions", "brdf", "btf"}
STRUCTURES = {"core", "mesostructure"}
RECORDINGS = MATERIALS | {"files", "plans", "instruments"}
RECONSTRUCTION = RECORDINGS | {"reconstruction"}
RIGS = RECONSTRUCTION | STRUCTURES | {"plugins", "scenes", "imaging", "database"}
PICTURES = RIGS | {"rigs", "rendering", "planning", "perception", "methods"}
EVERYTHING = PICTURES | {"viewing", "evaluation", "doctor"}

# room: the rooms that it may import (docs/architecture.md says the same in words)
MAY_IMPORT = {
    "core": set(),
    "directions": {"core"},
    "brdf": {"core", "directions"},
    "btf": {"core", "directions", "brdf"},
    "files": MATERIALS,
    "imaging": {"core"},
    "instruments": {"core", "files"},
    "mesostructure": {"core"},
    "database": MATERIALS | {"files"},
    "plans": MATERIALS | {"database"},
    "reconstruction": MATERIALS | {"plans", "database"},
    "plugins": MATERIALS,
    "scenes": STRUCTURES,
    "rigs": RIGS,
    "methods": RIGS | {"rigs"},
    "perception": {"core"},
    "rendering": MATERIALS | {"files", "plugins", "scenes"},
    "planning": MATERIALS | {"files", "plugins", "scenes", "rendering"},
    "viewing": PICTURES,
    "evaluation": EVERYTHING,
    "doctor": EVERYTHING,
    "front_door": EVERYTHING | {"web"},
    "web": EVERYTHING,
    "cli": EVERYTHING | {"front_door", "web"},
}
# arrows against the flow; allowed inside a function only, never while a module is loaded
LAZILY = {
    ("core", "plugins"): "a variant is not ready before our plugins are registered in it",
    ("plugins", "files"): "a plugin's 'filename' may be of any format that we read",
    ("brdf", "viewing"): "a BRDF that shows itself in a notebook is drawn where BRDFs are drawn",
}

TOP_LEVEL = {
    *(".ci", ".gitignore", "Makefile", "README.md", "pyproject.toml"),
    *("CHANGELOG.md", "CITATION.cff", "LICENSE"),
    *("docs", "evaluation", "plugins", "scenes", "simrig", "tests"),
}


def forbidden(arrow: Arrow) -> bool:
    if (arrow.source, arrow.target) in LAZILY:
        return not arrow.lazy
    return arrow.target not in MAY_IMPORT.get(arrow.source, set())


def test_rooms_import_only_what_the_plan_allows() -> None:
    bad = [str(arrow) for arrow in every_arrow() if forbidden(arrow)]
    assert not bad, "\n".join(["against docs/architecture.md:", *bad])


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("simrig/plans/a.py", "from simrig.rigs.direct import gonioreflectometer"),
        ("simrig/brdf/a.py", "import simrig.files.load"),
        ("simrig/reconstruction/a.py", "def f():\n    from simrig import evaluation"),
        ("simrig/core/backend.py", "from simrig.plugins.register import register"),
        ("simrig/nowhere/a.py", "from simrig.core import errors"),
        ("evaluation/a.py", "from simrig.cli import frame"),
        ("scenes/a.py", "if True:\n    from simrig.plugins import make_bsdf"),
    ],
)
def test_a_planted_arrow_is_found(file: str, text: str) -> None:
    assert [a for a in arrows(ROOT / file, text) if forbidden(a)]


def test_no_room_is_imported_under_its_bare_name() -> None:
    """A bare ``import plugins`` would make a second copy of the modules."""
    bare = {"plugins", "scenes", "evaluation"}
    tests = sorted((ROOT / "tests").glob("*.py"))
    for path in [*source_files(), *tests]:
        for line, module, _ in imports(ast.parse(path.read_text())):
            assert module.split(".")[0] not in bare, f"{path}:{line}"


def test_relative_imports_are_not_used() -> None:
    for path in source_files():
        for node in ast.walk(ast.parse(path.read_text())):
            assert not (isinstance(node, ast.ImportFrom) and node.level), f"{path}:{node.lineno}"


def test_the_top_level_holds_only_what_was_given() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert {name.split("/")[0] for name in listed} == TOP_LEVEL


def all_module_names() -> list[str]:
    names = []
    for path in source_files():
        first, *rest = path.relative_to(ROOT).with_suffix("").parts
        parts = ("simrig", *rest) if first == "simrig" else ("simrig", first, *rest)
        names.append(".".join(parts).removesuffix(".__init__"))
    return names


def module_names() -> list[str]:
    return [name for name in all_module_names() if not name.endswith("__main__")]


def undocumented(module: ModuleType) -> Iterator[str]:
    """Yield the public functions and classes of a module that say nothing of themselves."""
    for name, item in vars(module).items():
        item = inspect.unwrap(item) if callable(item) else item
        own = getattr(item, "__module__", None) == module.__name__
        if name.startswith("_") or not own or not callable(item):
            continue
        written = item.__doc__ or ""
        if not written or written.startswith(f"{name}("):  # what a dataclass gives itself
            yield name


@pytest.mark.parametrize("name", module_names())
def test_everything_public_is_documented(name: str) -> None:
    if name.startswith("simrig.web"):
        for package in ("fastapi", "sqlalchemy"):
            pytest.importorskip(package, reason=f"'make install' brings {package}")
    module = importlib.import_module(name)
    assert module.__doc__
    assert list(undocumented(module)) == []


def loaded_with(path: Path, names: set[str]) -> set[str]:
    """Return the modules that a module imports while it is loaded."""
    found = set()
    for node, lazy in statements(ast.parse(path.read_text())):
        if lazy:
            continue
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        else:
            module = node.module or ""
            own = {f"{module}.{name.name}" for name in node.names} & names
            found |= own if len(own) == len(node.names) else own | {module}
    return found & names


def statements(
    node: ast.AST, lazy: bool = False
) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Yield the import statements below a node, and whether each stands inside a function."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child, lazy
        function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        yield from statements(child, lazy or function or only_for_types(child))


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return one circle of imports for each module that leads back to itself."""
    found: list[list[str]] = []
    done: set[str] = set()

    def visit(name: str, above: list[str]) -> None:
        if name in above:
            found.append([*above[above.index(name) :], name])
        elif name not in done:
            for other in sorted(graph[name]):
                visit(other, [*above, name])
            done.add(name)

    for name in sorted(graph):
        visit(name, [])
    return found


def test_there_is_no_circle_of_imports() -> None:
    graph: dict[str, set[str]] = {}
    by_name = dict(zip(all_module_names(), source_files(), strict=True))
    for name, path in by_name.items():
        graph[name] = loaded_with(path, set(by_name)) - {name}
    assert circles(graph) == []


def test_a_planted_circle_is_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == [["b", "c", "b"]]
