"""CLIP and MobileCLIP: pictures and texts in one space (Radford et al. 2021, Vasu et al. 2024).

Files: ``pixel_values`` -> ``image_embeds`` and ``input_ids`` -> ``text_embeds``, or both in one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.perception.families.towers import ImageTower, TextTower
from irsd.perception.models import Session
from irsd.perception.pixels import CLIP_LEVELS, Filter, Levels, crop_square, planes
from irsd.perception.tokens import Tokens


class ClipImageEncoder(ImageTower):
    """An ImageEncoder."""

    def __init__(
        self,
        session: Session,
        name: str,
        *,
        side_px: int = 224,
        kind: Filter = "bicubic",
        levels: Levels = CLIP_LEVELS,
        batch: int = 8,
    ) -> None:
        """name: of the space that the text encoder of the same model shares. The defaults are CLIP's; MobileCLIP-S0 takes
        256 pixels, bilinear and UNIT_LEVELS. batch: most crops a run (eight at once cost a tenth less than one by one; with
        int8 files company moves a vector by 1e-4 in cosine). ModelError when the file is no such model."""

        def prepare(crop: NDArray[np.uint8]) -> NDArray[np.float32]:
            return planes(crop_square(crop, side_px, kind), levels)

        super().__init__(session, name, ("image_embeds",), prepare, batch)


class ClipTextEncoder(TextTower):
    """A TextEncoder."""

    def __init__(
        self, session: Session, name: str, tokens: Tokens, *, pad_id: int | None = None, side_px: int = 224
    ) -> None:
        """pad_id: None for CLIP, which reads unpadded texts (it looks no further than the closing token); 0 for MobileCLIP, which
        sees the padding up to its 77 tokens as part of the text. side_px: of the picture that a file with both towers wants."""

        def tokenize(text: str) -> NDArray[np.int64]:
            return tokens.ids(text) if pad_id is None else np.asarray(tokens.padded([text], pad_id)[0][0])

        super().__init__(session, name, ("text_embeds",), tokenize, side_px)
