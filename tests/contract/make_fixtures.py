"""Makes the contract fixtures: ``make fixtures``, or in that environment ``python tests/contract/make_fixtures.py [family ...]``.

Needs torch, transformers and optimum (fixture_makers/requirements.txt); the tests that use the fixtures need none of them. A module of
``fixture_makers`` with a function ``make(folder)`` is a family; it fills its empty folder.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import pkgutil
import shutil
import sys
import time

import fixture_makers
from contract_fixtures import FIXTURES, MAX_BYTES, write_manifest

_RECORDED = ("torch", "transformers", "optimum-onnx", "onnx", "tokenizers", "pillow", "numpy")


def main(chosen: list[str]) -> None:
    versions = {name: importlib.metadata.version(name) for name in _RECORDED}
    for family in chosen or [module.name for module in pkgutil.iter_modules(fixture_makers.__path__)]:
        make = getattr(importlib.import_module(f"fixture_makers.{family}"), "make", None)
        if make is None:
            continue
        started = time.monotonic()
        folder = FIXTURES / family
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        make(folder)
        write_manifest(family, versions)
        size = sum(path.stat().st_size for path in folder.iterdir())
        print(f"{family:16} {size / 1e3:8.0f} kB {time.monotonic() - started:6.1f} s")
    total = sum(path.stat().st_size for path in FIXTURES.rglob("*") if path.is_file())
    print(f"{'all':16} {total / 1e3:8.0f} kB, at most {MAX_BYTES / 1e3:.0f}")


if __name__ == "__main__":
    main(sys.argv[1:])
