"""Opening the models that the configuration names. One that is missing costs its stage, not the daemon, and is said in the status."""

from __future__ import annotations

import dataclasses
import gc
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from irsd.config import IrsdConfig
from irsd.core.errors import ModelError
from irsd.perception.budget import Governor
from irsd.perception.encoder import LabelEncoder
from irsd.perception.eyes import open_eyes
from irsd.perception.naming import Namer
from irsd.perception.nano import open_namer
from irsd.perception.worker import LiveEyes

_log = logging.getLogger(__name__)


def open_live_eyes(config: IrsdConfig, missing: list[str]) -> LiveEyes | None:
    """The models opened and tried once; None where the configuration wants none, or one of them is missing (said in ``missing``)."""
    if not config.perception.image_encoder and not config.perception.nano:
        return None
    try:
        opened = open_eyes(config.perception, config.models)
    except ModelError as error:
        _log.error("irsd sees nothing by itself: %s", error)
        missing.append(f"eyes: {error}")
        return None
    eyes = LiveEyes(opened.chain, Governor(config.budget, opened.costs), threads=opened.threads, models=opened.models)
    eyes.warm_up()
    for model in opened.models():
        _log.info("%(model)s %(part)s: %(precision)s on %(providers)s %(fallback)s", model)
    return eyes


def open_names(config: IrsdConfig, labels: LabelEncoder, missing: list[str]) -> Namer | None:
    """Who names things by shape, beside the shipped eyes; None where others see, or the network is missing (said in ``missing``)."""
    if config.perception.image_encoder or not config.perception.nano:
        return None
    try:
        return open_namer(config.perception, labels)
    except ModelError as error:
        _log.error("things that only the LiDAR sees stay unknown: %s", error)
        missing.append(f"names: {error}")
        return None


def without_lost_network(config: IrsdConfig, missing: list[str]) -> IrsdConfig:
    """The configuration without a structure network that can't be opened: geometry alone labels walls and floors then."""
    network = config.pipeline.mapping.network
    if not network.model or Path(network.model).is_file():
        return config
    missing.append(f"structure network: there is no file {network.model}")
    _log.error("walls and floors are told by geometry alone: there is no file %s", network.model)
    mapping = dataclasses.replace(config.pipeline.mapping, network=dataclasses.replace(network, model=""))
    return dataclasses.replace(config, pipeline=dataclasses.replace(config.pipeline, mapping=mapping))


@contextmanager
def lasting_objects() -> Iterator[None]:
    """What is made inside stays: a stored map is millions of objects, and to look through them again and again for garbage costs a
    tenth of the start. Nor is the collector shown them later."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
