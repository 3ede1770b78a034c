"""The commands of irsctl and their options. Each command imports what it needs when it runs, so that the answer is quick.

Exit codes: 0 done; 1 error; 2 wrong usage; 3 ambiguous; 4 not found; 5 unreachable; 6 the drive failed or was cancelled;
7 refused: a model's bytes, contract or accuracy.
"""

from __future__ import annotations

from pathlib import Path

import click

from irsd.ctl.editing import EDITING
from irsd.ctl.keeping import KEEPING
from irsd.ctl.link import Target
from irsd.ctl.models import models

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--robot", envvar="IRSD_ROBOT", help="Name of the robot (default: the only one there is).")
@click.option("--endpoint", envvar="IRSD_ENDPOINT", help="Where irsd listens, e.g. tcp/10.0.0.5:7448.")
@click.option("--timeout", "timeout_s", default=3.0, show_default=True, help="Seconds to wait for an answer.")
@click.version_option(package_name="irsd", prog_name="irsctl")
@click.pass_context
def cli(context: click.Context, robot: str | None, endpoint: str | None, timeout_s: float) -> None:
    """Ask irsd what it knows, and send the robot to it."""
    context.obj = Target(robot, endpoint, timeout_s)


# -------------------------------------------------------------------------------------------------- asking a running irsd
@cli.command()
@json_option
@click.pass_obj
def status(target: Target, as_json: bool) -> int:
    """How irsd is doing: sensors, stages, drops, faults."""
    from irsd.ctl import live

    return live.status(target, as_json)


@cli.command()
@click.option(
    "--config", type=click.Path(dir_okay=False, path_type=Path), help="irsd.yaml (default: what irsd would read)."
)
@click.option(
    "--listen", "listen_s", default=3.0, show_default=True, type=click.FloatRange(0.1, 60.0), help="Seconds to listen."
)
@json_option
@click.pass_obj
def doctor(target: Target, config: Path | None, listen_s: float, as_json: bool) -> int:
    """Look at everything that must be right before irsd can work, and say what to do about what is not."""
    from irsd.ctl import doctor as checks

    return checks.doctor(target, config, listen_s, as_json)


@cli.command()
@click.option("--count", type=click.IntRange(1), help="Stop after showing it this many times.")
@click.pass_obj
def top(target: Target, count: int | None) -> int:
    """Stages, queues, drops and faults as a table, once a second."""
    from irsd.ctl import top as live_table

    return live_table.top(target, count)


@cli.command()
@click.pass_obj
def metrics(target: Target) -> int:
    """Print the status in Prometheus' text format."""
    from irsd.ctl import top as live_table

    return live_table.metrics(target)


@cli.command()
@json_option
@click.pass_obj
def tree(target: Target, as_json: bool) -> int:
    """The scene graph as a tree: building, rooms, things."""
    from irsd.ctl import live

    return live.tree(target, as_json)


@cli.command()
@click.argument("node_id", metavar="ID")
@json_option
@click.pass_obj
def show(target: Target, node_id: str, as_json: bool) -> int:
    """One node of the graph, such as R3 or I7."""
    from irsd.ctl import live

    return live.show(target, node_id, as_json)


@cli.command()
@json_option
@click.option("--count", type=click.IntRange(1), help="Stop after this many deltas.")
@click.pass_obj
def watch(target: Target, as_json: bool, count: int | None) -> int:
    """Print graph deltas as they happen."""
    from irsd.ctl import live

    return live.watch(target, as_json, count)


@cli.command()
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), default=Path("plan.svg"), show_default=True, help="svg or png."
)
@json_option
@click.pass_obj
def plan(target: Target, output: Path, as_json: bool) -> int:
    """Draw the graph over its plan."""
    from irsd.ctl import live

    return live.plan(target, output, as_json)


# ------------------------------------------------------------------------------------------------------------ driving
@cli.command(context_settings={"ignore_unknown_options": False})
@click.argument("query", required=False)
@click.option(
    "--within", "within_m", type=click.FloatRange(0.1, 5.0), help="Accept a greater distance to the target, metres."
)
@click.option(
    "--priority", default=0, type=click.IntRange(0, 100), help="Preempts goals of the same or lower priority only."
)
@click.option("--no-wait", is_flag=True, help="Return once the goal is accepted.")
@click.option(
    "--offline", type=click.Path(exists=True, file_okay=False, path_type=Path), help="Answer from a replay's folder."
)
@click.option(
    "--queries",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="With --offline: many queries (JSON).",
)
@click.option(
    "--from", "start", metavar="X,Y[,YAW]", help="With --offline: where the robot stands (default: the origin)."
)
@json_option
@click.pass_obj
def goto(
    target: Target,
    query: str | None,
    within_m: float | None,
    priority: int,
    no_wait: bool,
    offline: Path | None,
    queries: Path | None,
    start: str | None,
    as_json: bool,
) -> int:
    """Send the robot to what QUERY says, such as "TV in the laboratory"."""
    from irsd.ctl import drive

    if offline is not None:
        return drive.goto_offline(offline, query, queries, start, within_m, as_json)
    if query is None or queries is not None or start is not None:
        raise click.UsageError("give one QUERY (--queries and --from belong to --offline)")
    return drive.goto(target, query, within_m, priority, no_wait, as_json)


@cli.command()
@click.argument("query")
@click.option(
    "--within", "within_m", type=click.FloatRange(0.1, 5.0), help="Accept a greater distance to the target, metres."
)
@click.option(
    "--offline", type=click.Path(exists=True, file_okay=False, path_type=Path), help="Answer from a replay's folder."
)
@click.option("--from", "start", metavar="X,Y[,YAW]", help="With --offline: where the robot stands.")
@json_option
@click.pass_obj
def why(
    target: Target, query: str, within_m: float | None, offline: Path | None, start: str | None, as_json: bool
) -> int:
    """Say how the answer to QUERY comes about, without driving: what was considered, and why it was rejected."""
    from irsd.ctl import why as explain

    if start is not None and offline is None:
        raise click.UsageError("--from belongs to --offline")
    return explain.why(target, query, offline, start, within_m, as_json)


@cli.command()
@click.argument("query")
@json_option
def parse(query: str, as_json: bool) -> int:
    """Show what QUERY is understood to say; needs neither irsd nor a robot."""
    from irsd.ctl import why as explain

    return explain.parse(query, as_json)


@cli.command()
@json_option
@click.pass_obj
def cancel(target: Target, as_json: bool) -> int:
    """Stop the current goal; the robot holds."""
    from irsd.ctl import drive

    return drive.cancel(target, as_json)


# --------------------------------------------------------------------------------------------------------- recordings
@cli.command()
@click.argument(
    "files",
    metavar="FILE.mcap...",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
)
@click.option("--rate", default=1.0, show_default=True, type=click.FloatRange(0.01, 100.0), help="Times real time.")
@json_option
@click.pass_obj
def play(target: Target, files: tuple[Path, ...], rate: float, as_json: bool) -> int:
    """Put recordings on zenoh in real time, as the robot's sensors would."""
    from irsd.ctl import recordings

    return recordings.play(target, files, rate, as_json)


@cli.command()
@click.argument(
    "files",
    metavar="FILE.mcap...",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the results.")
@click.option(
    "--perception",
    metavar="nano|foundation|external:FILE.mcap",
    default="nano",
    show_default=True,
    help="Who sees where FILE.mcap holds no detections: irsd's own networks, the models of --config, or a recorded detector.",
)
@click.option("--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="irsd.yaml to use.")
@json_option
def replay(files: tuple[Path, ...], out: Path, perception: str, config: Path | None, as_json: bool) -> int:
    """Run the pipeline over recordings, as fast as it goes, and write the graph; or over one bundle, and compare the graph."""
    from irsd.ctl import recordings, records

    if len(files) == 1 and files[0].suffix == ".zip":
        return records.reproduce(files[0], out, as_json)

    return recordings.replay(files, out, perception, config, as_json)


# --------------------------------------------------------------------------------------------------------------- maps
@cli.command()
@click.argument("map_file", metavar="MAP.yaml|MAP.png", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--resolution", "resolution_m", type=click.FloatRange(0.005, 1.0), help="Metres per pixel, for a bare picture."
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("labels.png"), show_default=True, help="Label image, 16 bit."
)
@json_option
def rooms(map_file: Path, resolution_m: float | None, out: Path, as_json: bool) -> int:
    """Segment an existing 2D map (map_server) into rooms: labels, GeoJSON polygons and a picture."""
    from irsd.ctl import maps

    return maps.rooms(map_file, resolution_m, out, as_json)


# ------------------------------------------------------------------------------------------------------------- others
cli.add_command(models)
for command in (*EDITING, *KEEPING):
    cli.add_command(command)


@cli.group()
def config() -> None:
    """Check or show the settings of irsd."""


@config.command("check")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@json_option
def config_check(file: Path, as_json: bool) -> int:
    """Read FILE and name everything that is wrong with it."""
    from irsd.ctl import maps

    return maps.config_check(file, as_json)


@cli.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script: eval "$(irsctl completion bash)"."""
    from click.shell_completion import get_completion_class

    maker = get_completion_class(shell)
    if maker is None:
        raise click.UsageError(f"no completion for {shell}")
    click.echo(maker(cli, {}, "irsctl", "_IRSCTL_COMPLETE").source())


@cli.command()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("demo"), show_default=True)
@click.option("--seed", default=1, show_default=True, help="Which building.")
@click.option("--query", default="TV in the laboratory", show_default=True)
@click.option(
    "--detector", is_flag=True, help="The world's simulated detector sees, instead of the networks that irsd ships."
)
def demo(out: Path, seed: int, query: str, detector: bool) -> int:
    """The main job on the embedded world: explore, build the graph, drive to QUERY."""
    from irsd.ctl import demo as demonstration

    return demonstration.run(out, seed, query, detector)
