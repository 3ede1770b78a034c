"""The import table of docs/design.md as data: imports point down, gatekeepers alone touch their library, files stay small."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("irsd", "nav_bridge")

# Who may import whom: a module may import what its row names (prefixes of dotted names), itself and its own package.
# The first row whose prefix fits a module decides. Rows are ordered from the particular to the general.
MAY_IMPORT: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("irsd.core", ("irsd.core",)),
    ("irsd.graph.model", ("irsd.core",)),
    ("irsd.graph", ("irsd.core", "irsd.perception.encoder", "irsd.perception.aliases")),
    ("irsd.io", ("irsd.core", "irsd.graph.model", "irsd.graph.codec")),
    ("irsd.sensors", ("irsd.core", "irsd.io.cdr", "irsd.perception.detections")),
    ("irsd.mapping", ("irsd.core",)),
    ("irsd.rooms", ("irsd.core",)),
    ("irsd.perception", ("irsd.core", "irsd.models")),
    ("irsd.instances", ("irsd.core", "irsd.perception.detections")),
    ("irsd.models", ()),
    ("irsd.sim", ("irsd.core", "irsd.io", "irsd.sensors.encode", "irsd.sensors.replay")),
    ("irsd.health", ("irsd.core",)),
    ("irsd.faults", ("irsd.core", "irsd.health")),
    (
        "irsd.config",
        (
            "irsd.core",
            "irsd.sensors",
            "irsd.mapping",
            "irsd.rooms",
            "irsd.instances",
            "irsd.graph",
            "irsd.io",
            "irsd.health",
            "irsd.ingest",
            "irsd.perception",
            "irsd.privacy",
            "irsd.record",
        ),
    ),
    ("irsd.ingest", ("irsd.core", "irsd.io", "irsd.sensors", "irsd.perception.detections")),
    (
        "irsd.pipeline",
        (
            "irsd.core",
            "irsd.mapping",
            "irsd.rooms",
            "irsd.instances",
            "irsd.graph",
            "irsd.perception",
            "irsd.config",
            "irsd.lookout",
            "irsd.allround",
            "irsd.privacy",
            "irsd.warm",
        ),
    ),
    ("irsd.allround", ("irsd.core", "irsd.mapping", "irsd.instances", "irsd.perception")),
    ("irsd.opening", ("irsd.core", "irsd.config", "irsd.perception")),
    ("irsd.lookout", ("irsd.core", "irsd.mapping", "irsd.instances", "irsd.perception")),
    (
        "irsd.maploop",
        (
            "irsd.core",
            "irsd.graph.model",
            "irsd.graph.edits",
            "irsd.health",
            "irsd.ingest",
            "irsd.pipeline",
            "irsd.resume",
            "irsd.sensors",
        ),
    ),
    (
        "irsd.commands",
        ("irsd.core", "irsd.graph", "irsd.io", "irsd.maploop", "irsd.maps", "irsd.bundles", "irsd.resume"),
    ),
    ("irsd.record", ("irsd.core", "irsd.ingest", "irsd.io.cdr", "irsd.sensors")),
    ("irsd.bundles", ("irsd.core", "irsd.config", "irsd.graph", "irsd.maploop", "irsd.pipeline", "irsd.record")),
    ("irsd.reproduce", ("irsd",)),
    ("irsd.arguments", ("irsd.config", "irsd.io.keys")),
    ("irsd.stored", ("irsd.core", "irsd.config", "irsd.graph", "irsd.maps", "irsd.record", "irsd.resume")),
    ("irsd.maps", ("irsd.core", "irsd.graph", "irsd.keeper", "irsd.maploop", "irsd.pipeline")),
    ("irsd.keeper", ("irsd.core", "irsd.graph", "irsd.maploop", "irsd.pipeline", "irsd.plans", "irsd.resume")),
    ("irsd.resume", ("irsd.core", "irsd.mapping", "irsd.plans")),
    ("irsd.plans", ("irsd.core",)),
    ("irsd.privacy", ("irsd.core", "irsd.graph")),
    ("irsd.warm", ("irsd.core", "irsd.mapping", "irsd.rooms", "irsd.instances")),
    ("irsd.daemon", ("irsd",)),
    ("irsd.__main__", ("irsd",)),
    ("irsd.ctl", ("irsd",)),
    ("irsd", ()),
    ("nav_bridge", ("irsd.core", "irsd.graph.model", "irsd.graph.codec", "irsd.io", "irsd.perception.encoder")),
)

# Libraries that only their gatekeeper imports (prefixes of module names).
GATEKEEPERS: dict[str, tuple[str, ...]] = {
    "zenoh": ("irsd.io.session",),
    "onnxruntime": ("irsd.perception.models",),
    "onnx": ("irsd.perception.supply.quantise",),
    "yaml": ("irsd.config", "irsd.perception.catalogue", "nav_bridge.config"),
    "threading": ("irsd.core.runtime",),
    "queue": ("irsd.core.runtime",),
    "multiprocessing": ("irsd.core.runtime",),
    "concurrent": ("irsd.core.runtime",),
    "rosbags": ("irsd.io.cdr",),
    "mcap": ("irsd.sensors.replay",),
    "open3d": ("irsd.sim.raycast",),
    "embreex": ("irsd.sim.raycast",),
    "sqlite3": ("irsd.graph.store",),
    "networkx": ("irsd.graph.scene_graph", "nav_bridge.route"),
    "mavsdk": ("nav_bridge.sinks.mavlink",),
    "click": ("irsd.ctl", "nav_bridge.__main__"),
}

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules() -> list[tuple[str, Path]]:
    return sorted((module_name(p), p) for package in PACKAGES for p in (ROOT / package).rglob("*.py"))


def covers(prefix: str, name: str) -> bool:
    return name == prefix or name.startswith(prefix + ".")


def imports_of(name: str, path: Path) -> Iterator[tuple[str, int]]:
    """Every imported module with its line, imports inside functions included; ``from x import y`` counts as x and x.y."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join(
                    [*package.split(".")[: len(package.split(".")) - node.level + 1], *filter(None, [node.module])]
                )
            yield from ((f"{base}.{alias.name}", node.lineno) for alias in node.names)


def breach(name: str, imported: str) -> str | None:
    """What is wrong with one import, or None."""
    library = imported.split(".", maxsplit=1)[0]
    keepers = GATEKEEPERS.get(library)
    if keepers is not None and not any(covers(k, name) for k in keepers):
        return f"imports {library}, which only {', '.join(keepers)} may"
    if library not in PACKAGES:
        return None
    row, allowed = next((row for row in MAY_IMPORT if covers(row[0], name)), ("", ()))
    if (covers(row, imported) and row not in PACKAGES) or library == row == "nav_bridge":
        return None
    ok = any(covers(a, imported) for a in allowed)
    return None if ok else f"imports {imported}; {row} may import only {', '.join(allowed) or 'nothing of ours'}"


@pytest.mark.parametrize(("name", "path"), modules(), ids=lambda v: v if isinstance(v, str) else "")
def test_imports_point_down(name: str, path: Path) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {what}" for i, line in imports_of(name, path) if (what := breach(name, i))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(("name", "path"), modules(), ids=lambda v: v if isinstance(v, str) else "")
def test_files_and_functions_stay_small(name: str, path: Path) -> None:
    text = path.read_text()
    lines = text.count("\n")
    assert lines <= MAX_FILE_LINES, f"{path.relative_to(ROOT)} has {lines} lines: is it one room or two?"
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            assert length <= MAX_FUNCTION_LINES, (
                f"{path.relative_to(ROOT)}:{node.lineno} {node.name} has {length} lines"
            )


def test_a_wrong_import_is_found() -> None:
    """The check itself can fail: one sample of each kind of breach."""
    assert breach("irsd.core.types", "irsd.graph.model.RoomNode")
    assert breach("irsd.rooms.segment", "irsd.mapping.mapper.Mapper")
    assert breach("irsd.daemon", "nav_bridge.bridge")
    assert breach("nav_bridge.resolve", "irsd.pipeline")
    assert breach("irsd.daemon", "zenoh")
    assert breach("irsd.rooms.stage", "threading.Lock")
    assert breach("irsd.instances.memory", "irsd.perception.detections.build") is None
    assert breach("nav_bridge.bridge", "irsd.io.session.Session") is None
    assert breach("irsd.ctl.app", "irsd.pipeline.MapPipeline") is None
