"""The one way in which kernels are compiled.

Machine code is kept between starts: in ``NUMBA_CACHE_DIR`` if that is set, else in ``__pycache__`` beside the source, else (a
read-only installation) in the user's cache directory. Where none of them can be written, every start compiles anew. numba
notices a change of the file in which a kernel stands, but not of kernels that it calls in other files: keep those together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile a pure function over arrays at its first call. Exact arithmetic in the order written, one thread, no GIL."""
    try:
        compiled = numba.njit(function, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # no place for the cache
        compiled = numba.njit(function, nogil=True, error_model="numpy")
    return cast(_Function, compiled)
