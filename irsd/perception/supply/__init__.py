"""Getting models ready for work: fetch, check, quantise, judge. For irsctl; the daemon imports nothing of it."""

from __future__ import annotations

from irsd.core.errors import ModelError


class RefusedError(ModelError):
    """Bytes that are not what they should be, or a quantised file too far from its fp32 file. Nothing was taken into use."""


class UnreachableError(ModelError):
    """A file can't be fetched now; the message says which, from where, and where to put it by hand."""
