# SPDX-License-Identifier: LGPL-3.0-or-later
"""The layout holds: imports form no circle, no arrow points up, and no folder is crowded."""

from __future__ import annotations

import ast
from pathlib import Path

# from the ground up; a room imports from its own floor and from those below it
FLOORS = (
    ("errors", "signals", "progress"),
    ("parameters", "fenics", "interpolation", "output", "solvers"),
    ("geometry", "materials"),
    ("closures",),
    ("correlations", "laws"),
    ("operation", "cloud"),
    ("models",),
    ("scenes",),
    ("case",),
    ("study",),
    ("bench",),
    ("cli",),
)
MOST_MODULES, MOST_LINES = 12, 60


def modules(root: Path) -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    found = {}
    for path in (root / "fem_tfm").rglob("*.py"):
        name = ".".join(path.relative_to(root).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


def imports(known: dict[str, Path]) -> dict[str, set[str]]:
    """What each module imports of the package, within functions and for types alike."""
    found: dict[str, set[str]] = {}
    for name, path in known.items():
        found[name] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names if alias.name in known}
            elif isinstance(node, ast.ImportFrom) and node.module in known:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                found[name] |= {one if one in known else node.module for one in inner}
        # the face of the package loads its names late
        found[name] -= {"fem_tfm", name}
    found["fem_tfm"] = set()
    return found


def test_imports_form_no_circle(root: Path) -> None:
    """Modules can be taken away one after another, each without what it imports being left."""
    left = imports(modules(root))
    while left:
        free = {name for name, needs in left.items() if not needs & left.keys()}
        assert free, f"a circle among {sorted(left)}"
        left = {name: needs for name, needs in left.items() if name not in free}


def test_no_arrow_points_up(root: Path) -> None:
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    wrong = []
    for name, needs in imports(modules(root)).items():
        parts = name.split(".")
        if len(parts) == 1 or parts[1] == "__main__":
            continue
        wrong += [(name, need) for need in needs if floor[need.split(".")[1]] > floor[parts[1]]]
    assert not wrong


def test_no_folder_is_crowded(root: Path) -> None:
    for folder in {path.parent for path in (root / "fem_tfm").rglob("*.py")}:
        names = [path.name for path in folder.glob("*.py") if not path.name.startswith("__")]
        assert len(names) <= MOST_MODULES, folder


def test_functions_are_short(root: Path) -> None:
    long = []
    for path in (root / "fem_tfm").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                if lines > MOST_LINES:
                    long.append(f"{path.name}: {node.name} has {lines} lines")
    assert not long


def test_no_room_asks_the_face_of_the_package(root: Path) -> None:
    """It names what stands above, so only modules and folders are taken through it."""
    wrong = []
    for path in (root / "fem_tfm").rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        froms = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        names = {alias.name for n in froms if n.module == "fem_tfm" for alias in n.names}
        entries = (root / "fem_tfm").iterdir()
        rooms = {entry.stem for entry in entries if entry.is_dir() or entry.suffix == ".py"}
        wrong += [(path.name, name) for name in names - rooms]
    assert not wrong
