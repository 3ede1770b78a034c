"""What the scorers of all roles share: where things are, rows of the table, ranks of names, a picture of the confusion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Evaluation:
    """data: a recording's folder with its truth; models: the folder of the pack; out: where pictures go, None: nowhere."""

    data: Path
    models: Path
    out: Path | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the table. below: the bar is the most that is allowed, not the least."""

    role: str
    measure: str
    value: float | None
    bar: float | None = None
    aim: float | None = None
    below: bool = False

    @property
    def met(self) -> bool:
        """Whether the bar is held."""
        if self.value is None or self.bar is None:
            return False
        return self.value <= self.bar if self.below else self.value >= self.bar


def ranks(
    vectors: NDArray[np.float32], labels: Sequence[str], names: Sequence[str], name_vectors: NDArray[np.float32]
) -> NDArray[np.int64]:
    """[n] place of each thing's true name among names, 0 = first, by the cosines of vectors [n, D] and name_vectors [m, D]."""
    order = np.argsort(-(vectors @ name_vectors.T), axis=1)
    right = np.array([names.index(label) for label in labels])
    return np.argmax(order == right[:, None], axis=1)


def confusion(path: Path, truth: Sequence[str], called: Sequence[str], title: str) -> None:
    """Writes a picture (SVG): what is truly there in rows, what it was called in columns, how often as the darkness of a cell."""
    rows, columns = sorted(set(truth)), sorted(set(truth) | set(called))
    counts, of_row = Counter(zip(truth, called, strict=True)), Counter(truth)
    side, left, top = 18, 150, 150
    width, height = left + side * len(columns) + 10, top + side * len(rows) + 10
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="11">'
    ]
    parts.append(
        f'<rect width="{width}" height="{height}" fill="white"/><text x="8" y="16" font-size="12">{escape(title)}</text>'
    )
    for c, name in enumerate(columns):
        x, y = left + side * c + 13, top - 6
        parts.append(f'<text transform="translate({x},{y}) rotate(-60)">{escape(name)}</text>')
    for r, name in enumerate(rows):
        y = top + side * r
        parts.append(f'<text x="{left - 6}" y="{y + 13}" text-anchor="end">{escape(name)} ({of_row[name]})</text>')
        for c, other in enumerate(columns):
            n = counts[name, other]
            colour = "34,120,60" if name == other else "190,40,40"
            opacity = 0.06 if n == 0 else 0.25 + 0.75 * n / of_row[name]
            fill = "120,120,120" if n == 0 else colour
            parts.append(
                f'<rect x="{left + side * c}" y="{y}" width="{side - 1}" height="{side - 1}" fill="rgb({fill})" fill-opacity="{opacity:.2f}"/>'
            )
            if n:
                parts.append(
                    f'<text x="{left + side * c + side / 2}" y="{y + 13}" text-anchor="middle" fill="white">{n}</text>'
                )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*parts, "</svg>"]) + "\n")
