"""Looks at map and target again and again while a goal is driven, on its own thread: asking irsd may take long, driving may not."""

from __future__ import annotations

import logging

from irsd.core.errors import IrsdError
from irsd.core.runtime import Cell, Stopper, Worker
from nav_bridge.drive import View
from nav_bridge.source import Source

_log = logging.getLogger(__name__)


class Scout:
    """``aim`` says what to look at, ``view`` is what was seen last. Both may be called from any one thread."""

    def __init__(self, source: Source, period_s: float) -> None:
        self._source = source
        self._period_s = period_s
        self._aim: Cell[tuple[int, str | None] | None] = Cell(None)
        self._view: Cell[View | None] = Cell(None)
        self._stopper = Stopper()
        self._worker = Worker("scout", self._run).start()

    def aim(self, plan_seq: int | None, instance: str | None = None) -> None:
        """Look for this plan at the map and, if it is one, at this instance; None: rest."""
        self._view.set(None)
        self._aim.set(None if plan_seq is None else (plan_seq, instance))

    def view(self) -> View | None:
        """What was seen last; it may still be of the plan before."""
        return self._view.get()

    @property
    def alive(self) -> bool:
        return self._worker.alive

    def close(self) -> None:
        self._stopper.request("closed")
        self._worker.join(self._period_s + 5.0)

    def _run(self) -> None:
        while not self._stopper.wait(self._period_s):
            aim = self._aim.get()
            if aim is None:
                continue
            try:
                costs = self._source.cost_map()
                surface = None if aim[1] is None else self._source.points(aim[1])
            except IrsdError as error:
                _log.warning("could not look at map and target: %s", error)
                continue
            self._view.set(View(aim[0], costs, surface))
