"""What the perception thread and the replay know of a chain, and what a chain knows of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol, TypeVar

from irsd.core.types import Detections
from irsd.perception.budget import Rung, Stage
from irsd.perception.job import PerceptionJob

T = TypeVar("T")

Trial = tuple[Stage, int, Callable[[], Any]]
"""(stage, items, the run) of a model on noise."""


class Seer(Protocol):
    """A chain as the perception thread and the replay know it."""

    @property
    def dimension(self) -> int:
        """Of the embeddings."""
        ...

    def see(self, job: PerceptionJob, rung: Rung, runner: Runner) -> Detections | None:
        """What the job's picture shows; None when not even the first stage could run."""
        ...

    def cancel(self) -> None:
        """End what runs, from another thread."""
        ...

    def clear(self) -> None:
        """Let runs start again."""
        ...

    def trials(self) -> Iterator[Trial]:
        """One run of every model on noise, with few and with more items where the number matters."""
        ...


class Runner(Protocol):
    """Who decides whether and when a model runs, and counts what it costs."""

    def run_stage(self, stage: Stage, items: int, work: Callable[[], T]) -> T | None:
        """The work's result; None when it was refused or ended early."""
        ...

    def batch(self, stage: Stage, most: int) -> int:
        """How many of ``most`` items should go into one run."""
        ...

    def drop(self, what: str, amount: int) -> None:
        """Note what was left out."""
        ...

    def pictured(self, masks: int, crops: int) -> None:
        """Note how many masks a picture has, and how many crops of them would be worth embedding."""
        ...
