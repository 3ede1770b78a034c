"""What is wrong with nav_bridge itself, told to whoever asks: queryable and samples of ``irs/<robot>/nav/faults``, and the log."""

from __future__ import annotations

import json
import logging

from irsd.io.keys import RobotKeys
from irsd.io.session import Session

_log = logging.getLogger(__name__)


class FaultBoard:
    """The faults there are, by code. ``show`` is for one thread; the queryable may answer on another."""

    def __init__(self, session: Session, keys: RobotKeys) -> None:
        self._session = session
        self._key = keys.nav("faults")
        self._shown: dict[str, tuple[str, ...]] = {}
        self._document = self._said()
        self._handle = session.queryable(self._key, lambda query: query.reply(self._key, self._document))

    def show(self, code: str, texts: tuple[str, ...]) -> None:
        """The faults of one kind as they are now. Logged and put only when they have changed."""
        before = self._shown.get(code, ())
        if texts == before:
            return
        self._shown[code] = texts
        self._document = self._said()
        for text in texts:
            if text not in before:
                _log.warning("%s: %s", code, text)
        self._session.put(self._key, self._document)

    def _said(self) -> bytes:
        faults = [{"code": code, "text": text} for code, texts in self._shown.items() for text in texts]
        return json.dumps({"schema": "irs/nav/faults/1", "faults": faults}).encode()

    def close(self) -> None:
        self._handle.close()
