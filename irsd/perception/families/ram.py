"""RAM, the Recognize Anything Model (Zhang et al. 2023): scores of a fixed list of 4585 tags, each with its own threshold.

Files: ``image`` [1, 3, 384, 384] -> ``logits`` [1, tags]; or, as the repository's own export has it, ``tag`` [1, tags], 1 where the
thresholds in the graph are passed. Beside it the list of tags and their thresholds, a line each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.families.contract import require
from irsd.perception.models import Session
from irsd.perception.pixels import IMAGENET_LEVELS, planes, resize
from irsd.perception.roles import Tags

_IMAGE, _LOGITS, _TAG = "image", "logits", "tag"


class Ram:
    """A Tagger."""

    def __init__(
        self, session: Session, tags: Sequence[str], thresholds: Sequence[float], *, side_px: int = 384
    ) -> None:
        """tags and thresholds: of each column of the output. ModelError when the file or the lists do not fit."""
        self._output = _LOGITS if _LOGITS in session.outputs else _TAG
        require(session, (_IMAGE,), (self._output,))
        if len(tags) != len(thresholds):
            raise ModelError(f"{len(tags)} tags but {len(thresholds)} thresholds")
        self._session, self._tags, self._side_px = session, tuple(tags), side_px
        self._thresholds = np.array(thresholds, np.float32)

    def tag(self, image_rgb: NDArray[np.uint8]) -> Tags:
        """See ``roles.Tagger``. Scores are probabilities, or 1 where the file has decided already."""
        pixels = planes(resize(image_rgb, self._side_px, self._side_px, "bilinear"), IMAGENET_LEVELS)
        (values,) = self._session.run({_IMAGE: pixels[None]}, (self._output,))
        if values.size != len(self._tags):
            raise ModelError(f"{self._session.path.name} scores {values.size} tags, the list has {len(self._tags)}")
        flat = values.reshape(-1)
        if self._output == _LOGITS:
            scores = np.asarray(1 / (1 + np.exp(-flat.astype(np.float64))), np.float32)
            passed = np.flatnonzero(scores > self._thresholds)
        else:
            scores = np.asarray(flat, np.float32)
            passed = np.flatnonzero(scores > 0)
        best = passed[np.argsort(-scores[passed], kind="stable")]
        return Tags(tuple(self._tags[k] for k in best.tolist()), scores[best])


def read_tags(text: str) -> tuple[str, ...]:
    """The tags of ``ram_tag_list.txt``."""
    return tuple(line.strip() for line in text.splitlines() if line.strip())


def read_thresholds(text: str) -> tuple[float, ...]:
    """The numbers of ``ram_tag_list_threshold.txt``. ModelError when a line is none."""
    try:
        return tuple(float(line) for line in text.splitlines() if line.strip())
    except ValueError as error:
        raise ModelError(f"thresholds of tags: {error}") from None
