"""What a detector says is wrong. Detectors are pure or own their window; ``irsd.faults`` keeps the ledger of all of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong now. code: a key of ``irsd.faults.ADVICE``; subject: the topic, thread, frame or file it is about;
    text: what was measured, in words.
    """

    code: str
    subject: str
    text: str
