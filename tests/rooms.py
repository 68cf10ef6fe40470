"""The rooms as the code has them: who imports whom, and how many lines each holds.

``make rooms`` draws the arrows into docs/architecture.md (``--draw``) and prints the lines of every
room; ``python tests/rooms.py REVISION`` has those of an earlier revision beside them.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("simrig", "plugins", "scenes", "evaluation")
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- drawn by `make rooms` -->", "<!-- end of what is drawn -->"


@dataclass(frozen=True)
class Arrow:
    """An import of one room by another."""

    file: str
    line: int
    source: str
    target: str
    lazy: bool

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.source} imports {self.target}"


def source_files() -> list[Path]:
    return [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def room_of(parts: tuple[str, ...]) -> str:
    """Return the room of a file, given by the parts of its path in the repository."""
    first, *rest = parts
    return rest[0].removesuffix(".py") if first == "simrig" else first


def room_of_file(path: Path) -> str:
    return room_of(path.relative_to(ROOT).parts)


def room_of_module(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def imported_modules(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [name.name for name in node.names]
    if isinstance(node, ast.ImportFrom) and node.module == "simrig":
        return [f"simrig.{name.name}" for name in node.names]
    if isinstance(node, ast.ImportFrom):
        return [node.module or ""]
    return []


def only_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def imports(node: ast.AST, lazy: bool = False) -> Iterator[tuple[int, str, bool]]:
    """Yield (line, module, inside a function or for types only) of every import below a node."""
    for child in ast.iter_child_nodes(node):
        for module in imported_modules(child):
            yield child.lineno, module, lazy  # type: ignore[attr-defined]
        function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        yield from imports(child, lazy or function or only_for_types(child))


def arrows(path: Path, text: str) -> Iterator[Arrow]:
    source = room_of_file(path)
    for line, module, lazy in imports(ast.parse(text)):
        if module.split(".")[0] != "simrig":
            continue
        target = room_of_module(module)
        if target not in (source, "__init__", "__version__"):
            yield Arrow(str(path.relative_to(ROOT)), line, source, target, lazy)


def every_arrow() -> list[Arrow]:
    return [arrow for path in source_files() for arrow in arrows(path, path.read_text())]


def reach(graph: dict[str, set[str]], start: str) -> set[str]:
    """Return all that a room leads to, itself apart unless in a circle."""
    found: set[str] = set()
    todo = list(graph.get(start, ()))
    while todo:
        room = todo.pop()
        if room not in found:
            found.add(room)
            todo += graph.get(room, ())
    return found


def reduced(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Leave out the arrows of a graph without circles that follow from the others."""
    return {
        room: {
            target
            for target in targets
            if not any(target in reach(graph, other) for other in targets - {target})
        }
        for room, targets in graph.items()
    }


def drawing() -> str:
    """Return the arrows as a Mermaid diagram, and all of them as a table."""
    graph: dict[str, set[str]] = {}
    lazy: dict[str, set[str]] = {}
    for arrow in every_arrow():
        (lazy if arrow.lazy else graph).setdefault(arrow.source, set()).add(arrow.target)
    rooms = sorted({*graph, *lazy, *(target for targets in graph.values() for target in targets)})
    few = reduced(graph)
    lines = ["```mermaid", "graph TD"]
    lines += [f"  {room} --> {other}" for room in rooms for other in sorted(few.get(room, ()))]
    lines += ["```", "", "| room | imports | inside functions only |", "| --- | --- | --- |"]
    for room in rooms:
        own, late = graph.get(room, set()), lazy.get(room, set())
        cells = (", ".join(sorted(names)) or "–" for names in (own, late - own))
        lines.append(f"| {room} | {' | '.join(cells)} |")
    return "\n".join(lines)


def drawn() -> str:
    """Return what the page has between its marks."""
    return PAGE.read_text().partition(BEGIN)[2].partition(END)[0].strip()


def draw() -> None:
    before, _, rest = PAGE.read_text().partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n\n{drawing()}\n\n{END}{after}")


def lines_now() -> Counter[str]:
    found: Counter[str] = Counter()
    for path in source_files():
        found[room_of_file(path)] += path.read_bytes().count(b"\n")
    return found


def lines_at(revision: str) -> Counter[str]:
    """Return the lines of every room in a revision of the repository."""
    command = ["git", "archive", "--format=tar", revision, "--", *FOLDERS]
    archive = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout
    found: Counter[str] = Counter()
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for member in files:
            text = files.extractfile(member)
            if text is not None and member.name.endswith(".py"):
                found[room_of(Path(member.name).parts)] += text.read().count(b"\n")
    return found


def main(arguments: list[str]) -> None:
    if arguments == ["--draw"]:
        draw()
        return
    columns = [*((revision, lines_at(revision)) for revision in arguments), ("now", lines_now())]
    rooms = sorted({room for _, lines in columns for room in lines})
    print(f"{'room':16}", *(f"{name[:10]:>10}" for name, _ in columns))
    for room in rooms:
        print(f"{room:16}", *(f"{lines[room] or '–':>10}" for _, lines in columns))
    print(f"{'all':16}", *(f"{lines.total():>10}" for _, lines in columns))


if __name__ == "__main__":
    main(sys.argv[1:])
