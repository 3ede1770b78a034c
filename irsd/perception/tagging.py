"""Tags without a tagger: a picture compared with every name of a vocabulary in the space of an image and a text encoder.

One run of the image encoder per picture; the names are embedded once. How cosines become scores is part of how a family was trained:
CLIP with a softmax over the texts (scores of one picture sum to 1), SigLIP with a sigmoid for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.roles import ImageEncoder, Tags, TextEncoder

PROMPT = "a photo of a {}"


@dataclass(frozen=True, slots=True)
class Likeness:
    """Cosines to scores: logits = scale * cosine + bias, then a sigmoid each, or with bias None a softmax over all names."""

    scale: float
    bias: float | None

    def scores(self, cosines: NDArray[np.float32]) -> NDArray[np.float32]:
        """float32 [.., n] in 0..1 of cosines float32 [.., n]."""
        logits = self.scale * cosines.astype(np.float64)
        if self.bias is not None:
            return np.asarray(1 / (1 + np.exp(-(logits + self.bias))), np.float32)
        weights = np.exp(logits - logits.max(-1, keepdims=True, initial=-np.inf))
        return np.asarray(weights / weights.sum(-1, keepdims=True), np.float32)


# The scales and the bias are weights of the published checkpoints (exp of what is stored), the same for all pictures.
CLIP_LIKENESS = Likeness(100.0, None)
SIGLIP_LIKENESS = Likeness(117.8, -12.9)


class ZeroShotTagger:
    """A Tagger over any vocabulary."""

    def __init__(
        self,
        images: ImageEncoder,
        texts: TextEncoder,
        vocabulary: Sequence[str],
        *,
        likeness: Likeness = CLIP_LIKENESS,
        top: int = 16,
        threshold: float = 0.01,
        prompt: str = PROMPT,
    ) -> None:
        """top: at most so many tags; threshold: least score of a tag. ModelError when the encoders don't share a space."""
        if (images.name, images.dimension) != (texts.name, texts.dimension):
            raise ModelError(
                f"pictures of {images.name} ({images.dimension}) and texts of {texts.name} ({texts.dimension}) can't be compared"
            )
        self._images, self._likeness, self._top, self._threshold = images, likeness, top, threshold
        self.vocabulary = tuple(dict.fromkeys(vocabulary))
        self._names = texts.encode_texts([prompt.format(name) for name in self.vocabulary])

    def tag(self, image_rgb: NDArray[np.uint8]) -> Tags:
        """See ``roles.Tagger``: the best of the vocabulary, best first."""
        return self.tags_of(self._images.encode_images([image_rgb])[0])

    def tags_of(self, embedding: NDArray[np.float32]) -> Tags:
        """The tags of a picture whose embedding float32 [D], unit length, is known already."""
        if not self.vocabulary:
            return Tags((), np.zeros(0, np.float32))
        scores = self._likeness.scores(self._names @ embedding)
        best = np.argsort(-scores, kind="stable")[: self._top]
        best = best[scores[best] >= self._threshold]
        return Tags(tuple(self.vocabulary[k] for k in best.tolist()), scores[best])
