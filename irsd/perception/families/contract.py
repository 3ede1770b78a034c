"""What adapters ask of every model file, so that one that does not fit is refused in words and not by a shape error far inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.models import Session


def require(session: Session, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    """ModelError unless the file has these inputs and outputs."""
    lacking = [n for n in inputs if n not in session.inputs] + [n for n in outputs if n not in session.outputs]
    if lacking:
        raise ModelError(
            f"{session.path.name} lacks {', '.join(lacking)}; it has inputs {session.inputs} and outputs {session.outputs}"
        )


def unit_rows(vectors: NDArray[np.float32], rows: int, session: Session) -> NDArray[np.float32]:
    """float32 [rows, D] of unit length. ModelError unless the network gave rows finite vectors other than zero."""
    if vectors.ndim != 2 or len(vectors) != rows:
        raise ModelError(f"{session.path.name}: vectors of shape {vectors.shape} for {rows} inputs")
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (np.isfinite(lengths) & (lengths > 0)).all():
        raise ModelError(f"{session.path.name}: a vector of no or infinite length")
    return np.asarray(vectors / lengths, np.float32)
