"""Shared fixtures. Recordings live beside the checkout; tests that need them skip with a reason where they are absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the recordings and maps with ground truth (``$IRSD_SHARED_DATA``, or ``../shared/data`` beside the checkout)."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("IRSD_SHARED_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"recordings are absent: {folder}")
    return folder


@pytest.fixture(scope="session")
def shared_tools(shared_data: Path) -> Path:
    """Folder of the scorers that belong to the recordings."""
    folder = shared_data.parent / "tools"
    if not folder.is_dir():
        pytest.skip(f"scorers are absent: {folder}")
    return folder
