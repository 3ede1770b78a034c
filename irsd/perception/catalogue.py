"""The catalogue of models: what is known of each, typed and checked whole (irsd/models/catalogue.yaml, and the site's own)."""

from __future__ import annotations

import importlib.resources
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from irsd.core.errors import ModelError

SITE_CATALOGUE = "catalogue.yaml"  # in the folder of the models, laid over the shipped one
PERMISSIVE = frozenset({"Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "ISC", "CC0-1.0", "CC-BY-4.0"})
ROLES = ("tagger", "detector", "segmenter", "image_encoder", "text_encoder")
METHODS = ("matmul", "static")
FLOORS = ("cosine", "retrieval", "box_iou", "box_agreement", "mask_iou", "tag_agreement")
_ABOUT = ("title", "roles", "family", "licence", "source", "note")
_KEYS = (*_ABOUT, "base", "files", "contract", "preprocess", "thresholds", "quantise", "cost", "floors")
_TENSOR = re.compile(r"(?P<dtype>float32|float16|int64|int32|uint8|bool)\[(?P<shape>[\w,]*)\]")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_NAME = re.compile(r"[a-z0-9][a-z0-9._-]*")
_PRECISION = re.compile(r"(fp|int|q|u?int)\d+[a-z0-9]*")


@dataclass(frozen=True, slots=True)
class ModelFile:
    """One file of a model. precision: ``fp32``, ``int8`` ..; empty for what is no network, such as a tokenizer.

    url: https, file or ``package:PACKAGE/FILE``; empty where the user brings the file. sha256, size_bytes: None where not known.
    """

    part: str
    precision: str
    url: str
    upstream_name: str
    size_bytes: int | None
    sha256: str | None

    @property
    def local_name(self) -> str:
        """What the file is called in the model's folder."""
        suffix = PurePosixPath(self.upstream_name).suffix
        return f"{self.part}.{self.precision}{suffix}" if self.precision else f"{self.part}{suffix}"


@dataclass(frozen=True, slots=True)
class TensorContract:
    """shape: a number is fixed, a word is free but the same everywhere in its part."""

    name: str
    dtype: str
    shape: tuple[int | str, ...]
    optional: bool


@dataclass(frozen=True, slots=True)
class PartContract:
    """What a network takes and gives. It may give more."""

    inputs: tuple[TensorContract, ...]
    outputs: tuple[TensorContract, ...]


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a part is quantised. exclude: names of nodes that stay float."""

    method: str
    exclude: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Cost:
    """As (fp32, int8), None where it was not measured: cpu_ms of one call on one thread; of a process over one without the part,
    rss_mb that stay between the calls and peak_mb during one."""

    cpu_ms: tuple[float | None, float | None]
    rss_mb: tuple[float | None, float | None]
    peak_mb: tuple[float | None, float | None]


@dataclass(frozen=True, slots=True)
class Model:
    """A catalogue entry. files: of all precisions; the parts of ``contracts`` are networks, other parts are data."""

    name: str
    title: str
    roles: tuple[str, ...]
    family: str
    licence: str
    source: str
    note: str
    files: tuple[ModelFile, ...]
    contracts: Mapping[str, PartContract]
    preprocess: Mapping[str, Any] = field(default_factory=dict)
    thresholds: Mapping[str, float] = field(default_factory=dict)
    recipes: Mapping[str, Recipe] = field(default_factory=dict)
    costs: Mapping[str, Cost] = field(default_factory=dict)
    floors: Mapping[str, float] = field(default_factory=dict)

    @property
    def permissive(self) -> bool:
        return self.licence in PERMISSIVE

    @property
    def parts(self) -> tuple[str, ...]:
        """All parts, networks and data, in the order of the catalogue."""
        return tuple(dict.fromkeys(file.part for file in self.files))

    def files_of(self, part: str) -> tuple[ModelFile, ...]:
        """The part in its precisions, in the order of the catalogue."""
        return tuple(file for file in self.files if file.part == part)

    def check_licence(self, accepted: tuple[str, ...]) -> None:
        """ModelError unless the licence is permissive or accepted by name."""
        if not self.permissive and self.licence not in accepted:
            raise ModelError(
                f"{self.name} has the licence {self.licence}, which is not a permissive one: read it at {self.source}, "
                f"and if you agree set models.accept_license: {self.licence} in irsd.yaml"
            )


def load_catalogue(directory: Path | None = None) -> dict[str, Model]:
    """The models by name: those of irsd, with the catalogue in ``directory`` laid over. ModelError names all that is wrong."""
    shipped = importlib.resources.files("irsd.models").joinpath("catalogue.yaml")
    document = _document("irsd's catalogue", shipped.read_text(encoding="utf-8"))
    site = None if directory is None else directory / SITE_CATALOGUE
    if site is not None and site.is_file():
        document = _laid_over(document, _document(str(site), site.read_text(encoding="utf-8")))
    return parse_catalogue(document)


def parse_catalogue(document: Mapping[str, Any]) -> dict[str, Model]:
    """A catalogue from plain keys and values. ModelError names all that is wrong with it."""
    reader = _Reader()
    reader.known("", document, ("schema", "models"))
    if document.get("schema") != 1:
        reader.problems.append(f"schema = {document.get('schema')!r}: must be 1")
    models = {str(name): reader.model(str(name), entry) for name, entry in (document.get("models") or {}).items()}
    if reader.problems:
        raise ModelError("\n  ".join(["the catalogue of models has problems:", *reader.problems]))
    return {name: model for name, model in models.items() if model is not None}


def find_model(catalogue: Mapping[str, Model], name: str) -> tuple[Model, str]:
    """The model and the precision asked for, of ``NAME`` or ``NAME@PRECISION`` (empty: the best there is). ModelError if unknown."""
    base, _, precision = name.partition("@")
    if base not in catalogue:
        raise ModelError(f"no model is called {base!r}; known are {', '.join(sorted(catalogue))}")
    return catalogue[base], precision


def _document(origin: str, text: str) -> dict[str, Any]:
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ModelError(f"{origin} is not YAML: {error}") from error
    if not isinstance(document, dict) or not isinstance(document.get("models", {}), dict):
        raise ModelError(f"{origin}: must hold 'schema: 1' and 'models:'")
    return document


def _laid_over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Sections merge, everything else is replaced."""
    out = dict(below)
    for key, value in above.items():
        old = out.get(key)
        out[key] = _laid_over(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return out


class _Reader:
    """Reads entries and collects what is wrong with them."""

    def __init__(self) -> None:
        self.problems: list[str] = []

    def known(self, where: str, section: Mapping[str, Any], keys: tuple[str, ...]) -> None:
        for key in section:
            if key not in keys:
                self.problems.append(f"{where}.{key}: unknown key; known here: {', '.join(keys)}".lstrip("."))

    def section(self, where: str, value: Any) -> Mapping[str, Any]:
        if value is None:
            return {}
        if isinstance(value, Mapping):
            return value
        self.problems.append(f"{where} = {value!r}: must be a section of keys and values")
        return {}

    def text(self, where: str, entry: Mapping[str, Any], key: str, default: str | None = None) -> str:
        value = entry.get(key, default)
        if not isinstance(value, str):
            self.problems.append(f"{where}.{key} = {value!r}: must be text")
            return ""
        return value

    def model(self, name: str, entry: Any) -> Model | None:
        before = len(self.problems)
        entry = self.section(name, entry)
        if not _NAME.fullmatch(name):
            self.problems.append(f"{name!r}: a name has lower-case letters, digits, '.', '-' and '_' only")
        self.known(
            name,
            entry,
            _KEYS,
        )
        roles = tuple(entry.get("roles") or ())
        if not roles or any(role not in ROLES for role in roles):
            self.problems.append(f"{name}.roles = {list(roles)}: must be some of {', '.join(ROLES)}")
        base = self.text(name, entry, "base", "")
        sections = {k: self.section(f"{name}.{k}", entry.get(k)) for k in ("files", "contract", "quantise", "cost")}
        numbers = {k: self.section(f"{name}.{k}", entry.get(k)) for k in ("thresholds", "floors")}
        for key, value in ((f"{name}.{k}.{n}", v) for k, found in numbers.items() for n, v in found.items()):
            if not isinstance(value, (int, float)) or not 0 <= value <= 1:
                self.problems.append(f"{key} = {value!r}: must be in 0 .. 1")
        self.known(f"{name}.floors", numbers["floors"], FLOORS)
        model = Model(
            name=name,
            title=self.text(name, entry, "title"),
            roles=roles,
            family=self.text(name, entry, "family"),
            licence=self.text(name, entry, "licence"),
            source=self.text(name, entry, "source"),
            note=self.text(name, entry, "note", ""),
            files=tuple(self.files(f"{name}.files", sections["files"], base)),
            contracts={p: self.contract(f"{name}.contract.{p}", c) for p, c in sections["contract"].items()},
            preprocess=dict(self.section(f"{name}.preprocess", entry.get("preprocess"))),
            thresholds=dict(numbers["thresholds"]),
            recipes={p: self.recipe(f"{name}.quantise.{p}", r) for p, r in sections["quantise"].items()},
            costs={p: self.cost(f"{name}.cost.{p}", c) for p, c in sections["cost"].items()},
            floors=dict(numbers["floors"]),
        )
        for kind, parts in (("contract", model.contracts), ("quantise", model.recipes), ("cost", model.costs)):
            self.problems += [
                f"{name}.{kind}.{p}: there is no such part in files" for p in parts if p not in model.parts
            ]
        networks = {file.part for file in model.files if file.precision}
        self.problems += [f"{name}.contract: lacks {p}" for p in sorted(networks - set(model.contracts))]
        return model if len(self.problems) == before else None

    def files(self, where: str, section: Mapping[str, Any], base: str) -> Iterator[ModelFile]:
        if not section:
            self.problems.append(f"{where}: names no file")
        for part, found in section.items():
            entry = self.section(f"{where}.{part}", found)
            if "path" in entry or "url" in entry:
                yield self.file(f"{where}.{part}", str(part), "", entry, base)
                continue
            for precision, variant in entry.items():
                if not _PRECISION.fullmatch(str(precision)):
                    self.problems.append(f"{where}.{part}.{precision}: is no precision such as fp32 or int8")
                place = f"{where}.{part}.{precision}"
                yield self.file(place, str(part), str(precision), self.section(place, variant), base)

    def file(self, where: str, part: str, precision: str, entry: Mapping[str, Any], base: str) -> ModelFile:
        self.known(where, entry, ("path", "url", "size_bytes", "sha256"))
        path, url = self.text(where, entry, "path", ""), self.text(where, entry, "url", "")
        if bool(path) == bool(url):
            self.problems.append(f"{where}: needs a path (below base) or a url, one of them")
        if url and not url.startswith(("https://", "file://", "package:")):
            self.problems.append(f"{where}.url = {url!r}: must begin with https://, file:// or package:")
        size_bytes, sha256 = entry.get("size_bytes"), entry.get("sha256")
        if size_bytes is not None and (not isinstance(size_bytes, int) or size_bytes <= 0):
            self.problems.append(f"{where}.size_bytes = {size_bytes!r}: must be a whole number above 0, or null")
        if "sha256" not in entry or (sha256 is not None and not _SHA256.fullmatch(str(sha256))):
            self.problems.append(
                f"{where}.sha256 = {sha256!r}: must be 64 hexadecimal digits, or null where it is not known"
            )
        full = url or (base + path if base else "")
        return ModelFile(part, precision, full, PurePosixPath(path or url.split("/")[-1]).name, size_bytes, sha256)

    def contract(self, where: str, value: Any) -> PartContract:
        entry = self.section(where, value)
        self.known(where, entry, ("inputs", "outputs"))
        inputs, outputs = (
            tuple(self.tensor(f"{where}.{k}", str(n), t) for n, t in self.section(f"{where}.{k}", entry.get(k)).items())
            for k in ("inputs", "outputs")
        )
        return PartContract(inputs, outputs)

    def tensor(self, where: str, name: str, text: Any) -> TensorContract:
        match = _TENSOR.fullmatch(str(text))
        if match is None:
            self.problems.append(f"{where}.{name} = {text!r}: must look like float32[batch,3,224,224]")
            return TensorContract(name, "", (), False)
        dimensions = (int(d) if d.isdigit() else d for d in match["shape"].split(",") if d)
        return TensorContract(name.removesuffix("?"), match["dtype"], tuple(dimensions), name.endswith("?"))

    def recipe(self, where: str, value: Any) -> Recipe:
        entry = self.section(where, value)
        self.known(where, entry, ("method", "exclude"))
        method, exclude = self.text(where, entry, "method"), entry.get("exclude") or ()
        if method not in METHODS:
            self.problems.append(f"{where}.method = {method!r}: must be one of {', '.join(METHODS)}")
        if not isinstance(exclude, (list, tuple)):
            self.problems.append(f"{where}.exclude = {exclude!r}: must be a list of names of nodes")
            exclude = ()
        return Recipe(method, tuple(map(str, exclude)))

    def cost(self, where: str, value: Any) -> Cost:
        entry = self.section(where, value)
        keys = ("cpu_ms", "rss_mb", "peak_mb")
        self.known(where, entry, keys)
        return Cost(*(self.pair(f"{where}.{key}", entry.get(key)) for key in keys))

    def pair(self, where: str, value: Any) -> tuple[float | None, float | None]:
        if isinstance(value, list) and len(value) == 2 and all(isinstance(v, int | float | None) for v in value):
            return value[0], value[1]
        self.problems.append(f"{where} = {value!r}: must be [fp32, int8], null where not measured")
        return None, None
