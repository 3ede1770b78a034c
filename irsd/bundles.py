"""A bundle: one zip from which someone elsewhere sees what irsd saw, what it was, and how it was. The way back: ``reproduce``.

meta.json       robot, versions, models with their hashes, the graph's hash and revision, whether the recording is complete
config.yaml     the settings, secrets removed            status.json   the last status, faults included
start.sqlite    the map with which irsd began, if any    recording/*.mcap   see ``irsd.record``
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from irsd.config import IrsdConfig, render_yaml
from irsd.core.errors import StoreError
from irsd.graph.codec import snapshot_to_json
from irsd.graph.model import GraphSnapshot
from irsd.maploop import MapLoop
from irsd.pipeline import MapPipeline
from irsd.record import FOLDER, START, Recorder

SCHEMA = "irs/bundle/1"
_PACKAGES = (
    "irsd",
    "numpy",
    "opencv-python-headless",
    "numba",
    "onnxruntime",
    "eclipse-zenoh",
    "rosbags",
    "mcap",
    "scipy",
)
_SECRET = re.compile(r"(?im)^(\s*\S*(?:password|passwd|secret|token|credential|private_key)\S*\s*:)\s*\S.*$")
_USER_INFO = re.compile(r"(?<=//)[^/\s@]+@")
_TIMEOUT_S = 60.0


class Bundles:
    """Makes bundles of a running irsd. Any thread but the map's may call."""

    def __init__(self, config: IrsdConfig, loop: MapLoop, recorder: Recorder, status: Callable[[], bytes]) -> None:
        self._config, self._loop, self._recorder, self._status = config, loop, recorder, status

    def make(self) -> bytes:
        """The zip. StoreError when the recording can't be read."""
        folder = Path(tempfile.mkdtemp(dir=self._recorder.start.parent.parent, prefix=".bundle-"))
        try:
            # On the map thread, so that the graph and the end of the recording are of one instant.
            snapshot, eyes = self._loop.call(self._mark, _TIMEOUT_S)
            found = self._recorder.link_into(folder, _TIMEOUT_S)
            why_not = found.why_not or ("irsd's own eyes answered in their own time" if eyes else "")
            meta = {**_versions(self._config), "graph_sha256": graph_hash(snapshot), "seq": snapshot.seq}
            meta |= {"map_id": snapshot.map_id, "complete": not why_not, "why_not": why_not}
            buffer = io.BytesIO()
            with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
                archive.writestr("meta.json", json.dumps(meta, indent=1))
                archive.writestr("config.yaml", without_secrets(render_yaml(self._config)))
                archive.writestr("status.json", self._status() or b"{}")
                if self._recorder.start.is_file():
                    archive.write(self._recorder.start, START)
                for file in found.files:
                    archive.write(file, f"{FOLDER}/{file.name}")
            return buffer.getvalue()
        except OSError as error:
            raise StoreError(f"the bundle can't be made: {error}") from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _mark(self, pipeline: MapPipeline) -> tuple[GraphSnapshot, bool]:
        self._recorder.event("bundle")
        return pipeline.snapshot(), pipeline.counters().get("keyframes_offered", 0) > 0


def graph_hash(snapshot: GraphSnapshot) -> str:
    """SHA-256 of the graph's document."""
    return hashlib.sha256(snapshot_to_json(snapshot)).hexdigest()


def without_secrets(text: str) -> str:
    """Settings as YAML without the values of keys that name secrets, and without users in addresses."""
    return _USER_INFO.sub("", _SECRET.sub(r"\1 ''", text))


def _versions(config: IrsdConfig) -> dict[str, Any]:
    packages = {}
    for name in _PACKAGES:
        try:
            packages[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            packages[name] = "absent"
    system = {"python": platform.python_version(), "system": platform.platform(), "machine": platform.machine()}
    return {"schema": SCHEMA, "robot": config.robot, "packages": packages, **system, "models": _models()}


def _models() -> Mapping[str, str]:
    """SHA-256 of every model file that came with irsd."""
    folder = Path(__file__).parent / "models"
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*.onnx"))
    }
