"""``irsctl``: the operator's hand on irsd and nav_bridge."""

from __future__ import annotations

import sys

import click

from irsd.core.errors import IrsdError
from irsd.ctl.app import cli


def main() -> None:
    """Run irsctl; an error of ours is one line on stderr and exit code 1."""
    try:
        code = cli.main(standalone_mode=False)
    except click.exceptions.Abort:
        code = 130
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except IrsdError as error:
        click.echo(f"irsctl: {error}", err=True)
        code = 1
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
