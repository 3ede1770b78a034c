"""``nav-bridge``: run the bridge, or answer goals offline on a saved map."""

from __future__ import annotations

import json
from pathlib import Path

import click

from irsd.core.errors import ConfigError, IrsdError
from irsd.core.logs import set_up_logging
from nav_bridge.config import BridgeSettings, find_settings, load_settings

_CONFIG = click.option("--config", type=click.Path(path_type=Path, dir_okay=False), help="YAML file with settings.")


@click.group(invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--robot", default=None, help="Name of the robot (overrides the config).")
@click.option("--endpoint", default=None, help="zenoh endpoint of irsd (overrides the config and IRSD_ENDPOINT).")
@click.option("-v", "--verbose", is_flag=True, help="Log details.")
@_CONFIG
@click.pass_context
def main(context: click.Context, robot: str | None, endpoint: str | None, verbose: bool, config: Path | None) -> None:
    """Drive a robot to what is named. Without a command: run until SIGINT or SIGTERM."""
    if context.invoked_subcommand is not None:
        return
    from nav_bridge.bridge import run_bridge  # noqa: PLC0415  zenoh and the encoder are of no use to ``offline --help``

    set_up_logging("debug" if verbose else "info")
    try:
        run_bridge(_settings(config), robot, endpoint)
    except IrsdError as error:
        raise click.ClickException(str(error)) from error


@main.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("query", required=False)
@click.option(
    "--queries", type=click.Path(path_type=Path, dir_okay=False), help="JSON list of objects with id and text."
)
@click.option("--from", "start", default="0,0,0", help="Where the robot is: X,Y or X,Y,YAW in the map frame.")
@click.option(
    "--within", "within_m", type=click.FloatRange(0.05, 10.0), help="Farthest distance to the target, metres."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_CONFIG
@click.pass_context
def offline(
    context: click.Context,
    folder: Path,
    query: str | None,
    queries: Path | None,
    start: str,
    within_m: float | None,
    as_json: bool,
    config: Path | None,
) -> None:
    """Answer QUERY, or all of --queries, on the map in FOLDER.

    Exit code of a single query: 0 resolved, 3 ambiguous, 4 not found, 5 unreachable.
    """
    from nav_bridge.offline import EXIT_CODES, answer_all, load_queries  # noqa: PLC0415  as above

    if (query is None) == (queries is None):
        raise click.UsageError("give either a QUERY or --queries FILE")
    robot = _pose(start)
    try:
        asked = load_queries(queries) if queries is not None else [(None, str(query))]
        answers = answer_all(folder, asked, robot, _settings(config), within_m)
    except IrsdError as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps(answers if queries is not None else answers[0], ensure_ascii=False))
    else:
        for answer in answers:
            click.echo(f"{answer['query']}: {answer['text']}")
    context.exit(0 if queries is not None else EXIT_CODES[answers[0]["status"]])


@main.command()
@click.argument("query")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_CONFIG
def parse(query: str, as_json: bool, config: Path | None) -> None:
    """Show what QUERY is understood to say; needs neither map nor robot."""
    from irsd.perception.encoder import AliasTable  # noqa: PLC0415  as above
    from nav_bridge.answer import parse_document  # noqa: PLC0415
    from nav_bridge.reader import Reader  # noqa: PLC0415

    try:
        reader = Reader(_settings(config).reader, AliasTable.load())
    except ConfigError as error:
        raise click.UsageError(str(error)) from error
    document = {"query": query, **parse_document(reader.read(query))}
    if as_json:
        click.echo(json.dumps(document, ensure_ascii=False))
    else:
        click.echo("\n".join(f"{name:13s} {value}" for name, value in document.items() if value not in ("", [], False)))


def _settings(given: Path | None) -> BridgeSettings:
    """As configured; a wrong file is a usage error (exit code 2), since it stays wrong however often one tries."""
    try:
        return load_settings(find_settings(given))
    except ConfigError as error:
        raise click.UsageError(str(error)) from error


def _pose(text: str) -> tuple[float, float, float]:
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise click.BadParameter("expected X,Y or X,Y,YAW", param_hint="--from")
    return numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0


if __name__ == "__main__":
    main()
