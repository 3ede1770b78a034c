"""From a model's name to something that plays its role: files checked, sessions opened, the family's adapter around them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from irsd.core.errors import ConfigError, ModelError
from irsd.core.settings import setting
from irsd.perception.aliases import AliasTable
from irsd.perception.catalogue import Model, find_model, load_catalogue
from irsd.perception.encoder import TextEncoder as MiniLm
from irsd.perception.families import (
    clip,
    efficient_sam,
    grounding_dino,
    minilm,
    mobile_sam,
    nanodet,
    owl,
    ram,
    sam,
    siglip,
)
from irsd.perception.models import CPU, PROVIDERS, Cancel, Session
from irsd.perception.pixels import CLIP_LEVELS, HALF_LEVELS, IMAGENET_LEVELS, UNIT_LEVELS
from irsd.perception.roles import Detector, ImageEncoder, Segmenter, Tagger, TextEncoder
from irsd.perception.shelf import Shelf, default_directory
from irsd.perception.tokens import Tokens

T = TypeVar("T")

LEVELS = {"clip": CLIP_LEVELS, "imagenet": IMAGENET_LEVELS, "half": HALF_LEVELS, "unit": UNIT_LEVELS}


@dataclass(frozen=True)
class ModelSettings:
    """Where the networks lie and what runs them."""

    directory: str = setting(
        "", "folder of the models; empty: $STATE_DIRECTORY/models (systemd), else $XDG_DATA_HOME/irsd/models"
    )
    threads: int = setting(1, "threads of each network", lo=1, hi=64)
    providers: tuple[str, ...] = setting(
        (CPU,),
        "what runs the networks, best first: tensorrt, cuda, openvino, cpu; what is missing here is named in the status",
    )
    accept_license: tuple[str, ...] | str = setting(
        (),
        "licences, other than permissive ones, that you have read and agree to, by the name that irsctl models list gives",
    )

    @property
    def folder(self) -> Path:
        return Path(self.directory).expanduser() if self.directory else default_directory()

    @property
    def accepted(self) -> tuple[str, ...]:
        return (self.accept_license,) if isinstance(self.accept_license, str) else self.accept_license


def check_models(settings: ModelSettings) -> None:
    """ConfigError for a provider that there is none of."""
    unknown = [name for name in settings.providers if name not in PROVIDERS]
    if unknown:
        raise ConfigError(f"models.providers = {list(settings.providers)}: must be some of {', '.join(PROVIDERS)}")


@dataclass(frozen=True, slots=True)
class Kit:
    """What an adapter is made of: a session per network, a path per other file."""

    model: Model
    sessions: Mapping[str, Session]
    files: Mapping[str, Path]


class ModelOpener:
    """Opens models by name (``NAME`` or ``NAME@PRECISION``) and says how they run. Raises ModelError with what to do."""

    def __init__(
        self,
        settings: ModelSettings,
        *,
        cancel: Cancel | None = None,
        open_session: Callable[..., Session] = Session,
    ) -> None:
        """cancel: ends the runs of all that is opened here."""
        self._settings, self._cancel, self._open_session = settings, cancel, open_session
        self.shelf = Shelf(settings.folder)
        self.catalogue = load_catalogue(settings.folder)
        self._opened: dict[str, dict[str, Any]] = {}

    def tagger(self, name: str) -> Tagger:
        """The model as a Tagger."""
        return self._make(name, "tagger", _TAGGERS)

    def detector(self, name: str, threshold: float | None = None) -> Detector:
        """The model as a Detector. threshold: in place of the catalogue's."""
        return self._make(name, "detector", _DETECTORS, threshold=threshold)

    def segmenter(self, name: str) -> Segmenter:
        """The model as a Segmenter."""
        return self._make(name, "segmenter", _SEGMENTERS)

    def image_encoder(self, name: str) -> ImageEncoder:
        """The model as an ImageEncoder; the text encoder of the same model shares its space."""
        return self._make(name, "image_encoder", _IMAGE_ENCODERS, leave_out=("text", "tokenizer"))

    def text_encoder(self, name: str) -> TextEncoder:
        """The model as a TextEncoder."""
        return self._make(name, "text_encoder", _TEXT_ENCODERS, leave_out=("image",))

    def status(self) -> list[dict[str, Any]]:
        """Per opened network: model, part, file, judged (against fp32, on this machine), providers, and what was not to be had."""
        return [self._opened[key] for key in sorted(self._opened)]

    def kit(self, name: str, leave_out: tuple[str, ...] = ()) -> Kit:
        """The model's files, checked, and its networks, opened."""
        model, precision = self.model(name), self.precision_of(name)
        model.check_licence(self._settings.accepted)
        sessions, files = {}, {}
        for part in model.parts:
            if part in leave_out:
                continue
            file = self.shelf.choose(model, part, precision)
            path = self.shelf.verified(model, file)
            if not file.precision:
                files[part] = path
                continue
            sessions[part] = self._open(path)
            record = self.shelf.record(model, file)
            self._opened[f"{model.name}/{part}"] = {
                "model": model.name,
                "part": part,
                "precision": file.precision,
                "judged": bool(record and record.judged),
                "providers": list(sessions[part].providers),
                "fallback": sessions[part].fallback,
            }
        return Kit(model, sessions, files)

    def _open(self, path: Path) -> Session:
        settings = self._settings
        return self._open_session(path, threads=settings.threads, providers=settings.providers, cancel=self._cancel)

    def model(self, name: str) -> Model:
        """What the catalogue knows of ``NAME`` or ``NAME@PRECISION``."""
        return find_model(self.catalogue, name)[0]

    def precision_of(self, name: str) -> str:
        """The precision that ``NAME@PRECISION`` insists on, else empty. ModelError when no part of the model has it."""
        model, precision = find_model(self.catalogue, name)
        known = {file.precision for part in model.parts for file in self.shelf.files_of(model, part)} - {""}
        if precision and precision not in known:
            raise ModelError(f"{model.name} has no {precision}, only {', '.join(sorted(known))}")
        return precision

    def _make(
        self,
        name: str,
        role: str,
        families: Mapping[str, Callable[[Kit], T]],
        leave_out: tuple[str, ...] = (),
        threshold: float | None = None,
    ) -> T:
        model = self.model(name)
        if role not in model.roles:
            can = sorted(other.name for other in self.catalogue.values() if role in other.roles)
            raise ModelError(f"{model.name} is no {role} but {', '.join(model.roles)}; for that take {', '.join(can)}")
        if model.family not in families:
            raise ModelError(f"{model.name}: irsd has no {role} of the family {model.family!r}")
        kit = self.kit(name, leave_out)
        if threshold is not None:
            kit = replace(kit, model=replace(model, thresholds={**model.thresholds, "score": threshold}))
        return families[model.family](kit)


# --------------------------------------------------------------------------------------------------------- the families
def _clip_image(kit: Kit) -> ImageEncoder:
    told = kit.model.preprocess
    levels = LEVELS[told["levels"]]
    return clip.ClipImageEncoder(
        kit.sessions["image"], kit.model.name, side_px=told["side_px"], kind=told["filter"], levels=levels
    )


def _clip_text(kit: Kit) -> TextEncoder:
    told = kit.model.preprocess
    tokens = Tokens.load(kit.files["tokenizer"], told["max_tokens"])
    return clip.ClipTextEncoder(
        kit.sessions["text"], kit.model.name, tokens, pad_id=told.get("pad_id"), side_px=told["side_px"]
    )


def _siglip_image(kit: Kit) -> ImageEncoder:
    return siglip.SiglipImageEncoder(kit.sessions["image"], kit.model.name, side_px=kit.model.preprocess["side_px"])


def _siglip_text(kit: Kit) -> TextEncoder:
    told, tokens = kit.model.preprocess, Tokens.load(kit.files["tokenizer"], siglip.CONTEXT)
    return siglip.SiglipTextEncoder(
        kit.sessions["text"], kit.model.name, tokens, pad_id=told["pad_id"], side_px=told["side_px"]
    )


def _minilm(kit: Kit) -> TextEncoder:
    return minilm.MiniLmTextEncoder(MiniLm(session=kit.sessions["text"]), kit.model.name)


def _owl(kit: Kit) -> Detector:
    told, tokens = kit.model.preprocess, Tokens.load(kit.files["tokenizer"], owl.CONTEXT)
    threshold = kit.model.thresholds["score"]
    return owl.Owl(kit.sessions["model"], tokens, side_px=told["side_px"], padded=told["padded"], threshold=threshold)


def _grounding_dino(kit: Kit) -> Detector:
    told, tokens = kit.model.preprocess, Tokens.load(kit.files["tokenizer"], grounding_dino.CONTEXT)
    return grounding_dino.GroundingDino(
        kit.sessions["model"],
        tokens,
        fixed_px=tuple(told["fixed_px"]) if "fixed_px" in told else None,
        threshold=kit.model.thresholds["score"],
    )


def _nanodet(kit: Kit) -> Detector:
    return nanodet.NanoDet(kit.sessions["model"], AliasTable.load(), threshold=kit.model.thresholds["score"])


def _sam(kit: Kit) -> Segmenter:
    return sam.Sam(kit.sessions["encoder"], kit.sessions["decoder"])


def _mobile_sam(kit: Kit) -> Segmenter:
    return mobile_sam.MobileSam(kit.sessions["encoder"], kit.sessions["decoder"])


def _efficient_sam(kit: Kit) -> Segmenter:
    return efficient_sam.EfficientSam(kit.sessions["encoder"], kit.sessions["decoder"])


def _ram(kit: Kit) -> Tagger:
    tags, thresholds = (kit.files[part].read_text(encoding="utf-8") for part in ("tags", "thresholds"))
    return ram.Ram(kit.sessions["model"], ram.read_tags(tags), ram.read_thresholds(thresholds))


_TAGGERS: Mapping[str, Callable[[Kit], Tagger]] = {"ram": _ram}
_DETECTORS: Mapping[str, Callable[[Kit], Detector]] = {
    "owl": _owl,
    "grounding_dino": _grounding_dino,
    "nanodet": _nanodet,
}
_SEGMENTERS: Mapping[str, Callable[[Kit], Segmenter]] = {
    "sam": _sam,
    "mobile_sam": _mobile_sam,
    "efficient_sam": _efficient_sam,
}
_IMAGE_ENCODERS: Mapping[str, Callable[[Kit], ImageEncoder]] = {"clip": _clip_image, "siglip": _siglip_image}
_TEXT_ENCODERS: Mapping[str, Callable[[Kit], TextEncoder]] = {
    "clip": _clip_text,
    "siglip": _siglip_text,
    "minilm": _minilm,
}
