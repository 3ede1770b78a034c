"""A short form of benchmarks/router.py: a router that dies and returns loses no delta."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest


def test_no_delta_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(Path(__file__).resolve().parents[2] / "benchmarks"), *sys.path])
    import router

    behind_s, received, sent = router.outlived(2)
    assert len(behind_s) == 2
    assert received == list(range(received[0], sent + 1))
