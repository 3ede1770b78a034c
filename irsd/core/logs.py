"""Log lines on stderr, with journald's priorities where it is journald that reads them."""

from __future__ import annotations

import logging
import os
import sys


def set_up_logging(level: str) -> None:
    """level: debug, info, warning or error. Replaces whatever was set up before."""
    handler = logging.StreamHandler(sys.stderr)
    journal = bool(os.environ.get("JOURNAL_STREAM"))
    handler.setFormatter(_JournalFormatter() if journal else logging.Formatter(_LINE))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


_LINE = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
_JOURNAL_PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}


class _JournalFormatter(logging.Formatter):
    """``<3>`` in front of every line; time and process are journald's own."""

    def __init__(self) -> None:
        super().__init__("%(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        prefix = f"<{_JOURNAL_PRIORITY.get(record.levelno, 6)}>"
        return "\n".join(prefix + line for line in super().format(record).splitlines())
