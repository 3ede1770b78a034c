"""What irsd finds on disk at its start: the store, the map in it, and the rolling recording that begins there."""

from __future__ import annotations

from irsd.config import IrsdConfig, state_directory
from irsd.graph.edits import known_prototypes
from irsd.graph.store import Store, StoredMap
from irsd.maps import PREVIOUS, SNAPSHOTS, SUFFIX
from irsd.record import FOLDER, Recorder
from irsd.resume import Resumption


def recorder_of(config: IrsdConfig, store: Store | None) -> Recorder | None:
    """The rolling recording, beside it the map from which it starts."""
    if not config.record.rolling_mb or store is None:
        return None
    recorder = Recorder(store.path.parent / FOLDER, config.record, config.privacy.retention_days)
    store.save_as(recorder.start)
    return recorder


def stored_map(store: Store | None, on_start: str) -> StoredMap | None:
    """The map to go on with; where a new one is wanted, the last one becomes the snapshot ``previous``."""
    stored = store.load() if store is not None else None
    if store is None or stored is None or on_start != "new":
        return stored
    store.save_as(store.path.parent / SNAPSHOTS / f"{PREVIOUS}{SUFFIX}")
    store.clear(frozenset(known_prototypes(stored.edits, stored.taught)))
    return None


def open_store(config: IrsdConfig) -> Store | None:
    """The store of this robot; None where nothing is kept."""
    if not config.store.enabled:
        return None
    return Store(state_directory(config.store) / config.robot)


def resumption_of(config: IrsdConfig, stored: StoredMap | None) -> Resumption:
    """What keeps frames from the map until they are known to be of it."""
    return Resumption(
        config.pipeline.mapping,
        {} if stored is None else stored.geometry,
        search=config.store.on_start == "relocalise",
        max_speed_mps=config.watch.max_speed_mps,
    )
