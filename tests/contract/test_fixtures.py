"""The committed fixtures are those that were made, all of them and nothing else, and small."""

from __future__ import annotations

import json

import pytest
from contract_fixtures import FIXTURES, MANIFEST, MAX_BYTES, checksums, families


@pytest.mark.parametrize("family", families())
def test_fixtures_are_those_of_the_manifest(family: str) -> None:
    listed = json.loads((FIXTURES / family / MANIFEST).read_text())["sha256"]
    assert checksums(family) == listed, f"run 'make fixtures FAMILIES={family}'"


def test_all_fixtures_together_are_small() -> None:
    assert sum(path.stat().st_size for path in FIXTURES.rglob("*") if path.is_file()) < MAX_BYTES
