"""``python -m irsd``: the daemon."""

from __future__ import annotations

import sys

from irsd.daemon import main as daemon_main


def main() -> None:
    """The console script ``irsd``."""
    sys.exit(daemon_main())


if __name__ == "__main__":
    main()
