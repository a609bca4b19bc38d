"""The house: which room may import which. No arrow runs up, and there is no circle of files."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "actioncli"
# Rooms from the ground floor up, and what each may import beside the ground floor.
GROUND = {"_version", "errors", "files"}
MAY_IMPORT = {
    "clips": set(),
    "model": {"clips"},
    "store": {"clips"},
    "pose": {"clips"},
    "recognition": {"clips", "model", "store"},
    "calibration": {"clips", "store", "recognition"},
    "live": {"clips", "pose", "recognition"},
    "archives": {"clips", "pose", "recognition"},
    "actions": {"clips", "store", "pose", "recognition", "calibration", "live"},
    "evaluation": {"clips", "model", "recognition"},
    "training": {"clips", "model", "recognition", "evaluation"},
    "report": {"clips", "model", "pose", "recognition", "calibration"},
    "studio": {"clips", "store", "pose", "recognition", "calibration", "live", "report", "actions"},
}
# The public names, and the commands, come from everywhere.
ROOF = {"actioncli", "__main__", "cli"}


def _modules() -> dict[str, Path]:
    found = {}
    for file in PACKAGE.rglob("*.py"):
        parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = file
    return found


def _imports(file: Path, modules: dict[str, Path]) -> set[str]:
    """Modules of the package that a file imports, wherever in it the import stands."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}: a relative import"
            named = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (named & modules.keys()) or {node.module or ""}
    return found & modules.keys()


def _room(module: str) -> str:
    return module.split(".")[1] if "." in module else "actioncli"


@pytest.fixture(scope="module")
def graph() -> dict[str, set[str]]:
    modules = _modules()
    return {name: _imports(file, modules) - {name} for name, file in modules.items()}


def test_at_most_twenty_rooms(graph: dict[str, set[str]]) -> None:
    rooms = {_room(module) for module in graph}
    assert rooms == GROUND | MAY_IMPORT.keys() | ROOF
    assert len(rooms) <= 20


def test_arrows_run_down(graph: dict[str, set[str]]) -> None:
    for module, imported in graph.items():
        room = _room(module)
        if room in ROOF:
            continue
        allowed = GROUND | {room} | MAY_IMPORT.get(room, set())
        wrong = {other for other in imported if _room(other) not in allowed}
        assert not wrong, f"{module} imports {', '.join(sorted(wrong))}"


def test_nothing_imports_the_commands(graph: dict[str, set[str]]) -> None:
    for module, imported in graph.items():
        if _room(module) not in {"cli", "__main__"}:
            assert not [other for other in imported if _room(other) == "cli"], module


def test_no_circle(graph: dict[str, set[str]]) -> None:
    # `actioncli` itself imports the public names when they are used.
    files = {module: imported - {"actioncli"} for module, imported in graph.items()}
    try:
        TopologicalSorter(files).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))
