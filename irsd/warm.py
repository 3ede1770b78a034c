"""Compiling every kernel before it is needed: at installation (``python -m irsd.warm``), and before the first frame.

Compiled code is kept (see ``irsd.core.jit``), so that only the first start on a machine pays for it.
"""

from __future__ import annotations

import logging
import sys

from irsd.core.runtime import monotonic_s
from irsd.instances import warm as instances
from irsd.mapping import warm as mapping
from irsd.rooms import kernels as rooms

_log = logging.getLogger(__name__)


def warm_up() -> None:
    """Compile or load the kernels of all stages: under a second when they are cached, else about half a minute."""
    began_s = monotonic_s()
    mapping.warm_up()
    rooms.warm_up()
    instances.warm_up()
    _log.info("kernels ready after %.1f s", monotonic_s() - began_s)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    warm_up()
