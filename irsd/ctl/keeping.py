"""The commands of irsctl about whole maps, and their options; what they do is in ``snapshots``, imported when one runs."""

from __future__ import annotations

from pathlib import Path

import click

from irsd.ctl.link import Target

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


@click.group()
def snapshot() -> None:
    """Save the map under a name, and bring saved ones back."""


@snapshot.command("save")
@click.argument("name")
@json_option
@click.pass_obj
def snapshot_save(target: Target, name: str, as_json: bool) -> int:
    """Save the map as NAME, in irsd's state directory."""
    from irsd.ctl import snapshots

    return snapshots.snapshot(target, "save", name, as_json)


@snapshot.command("list")
@json_option
@click.pass_obj
def snapshot_list(target: Target, as_json: bool) -> int:
    """The saved maps."""
    from irsd.ctl import snapshots

    return snapshots.snapshot(target, "list", "", as_json)


@snapshot.command("restore")
@click.argument("name")
@json_option
@click.pass_obj
def snapshot_restore(target: Target, name: str, as_json: bool) -> int:
    """Go on with the map NAME; the present one is kept as snapshot 'previous'."""
    from irsd.ctl import snapshots

    return snapshots.snapshot(target, "restore", name, as_json)


@snapshot.command("delete")
@click.argument("name")
@json_option
@click.pass_obj
def snapshot_delete(target: Target, name: str, as_json: bool) -> int:
    """Remove a saved map."""
    from irsd.ctl import snapshots

    return snapshots.snapshot(target, "delete", name, as_json)


@click.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.pass_obj
def export(target: Target, file: Path) -> int:
    """Write the whole map to FILE."""
    from irsd.ctl import snapshots

    return snapshots.export(target, file)


@click.command("import")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.pass_obj
def import_(target: Target, file: Path) -> int:
    """Go on with the map in FILE; the present one is kept as snapshot 'previous'."""
    from irsd.ctl import snapshots

    return snapshots.take_in(target, file)


def _place(_: click.Context, __: click.Parameter, value: str | None) -> tuple[float, float, float] | None:
    if value is None:
        return None
    try:
        x_m, y_m, yaw_rad = (float(part) for part in value.split(","))
    except ValueError as error:
        raise click.BadParameter("three numbers with commas between them, such as 3.5,-2,1.57") from error
    return x_m, y_m, yaw_rad


@click.group("map")
def map_() -> None:
    """Decide what becomes of a stored map that the scans do not fit."""


@map_.command("accept")
@click.pass_obj
def map_accept(target: Target) -> int:
    """It is the stored place, and odometry is where it was: go on with the map."""
    from irsd.ctl import snapshots

    return snapshots.decide(target, "accept")


@map_.command("new")
@click.pass_obj
def map_new(target: Target) -> int:
    """Begin an empty map; the stored one is kept as snapshot 'previous', and what was taught stays known."""
    from irsd.ctl import snapshots

    return snapshots.decide(target, "new")


@click.command()
@click.option("--at", metavar="X,Y,YAW", callback=_place, help="About where it is in the map: metres, and radians.")
@click.option("--wait", "wait_s", type=click.FloatRange(0, 60), default=20.0, show_default=True, help="Seconds.")
@json_option
@click.pass_obj
def relocalise(target: Target, at: tuple[float, float, float] | None, wait_s: float, as_json: bool) -> int:
    """Look for the robot in the map, from the next sweeps on; nothing is merged until it is found."""
    from irsd.ctl import snapshots

    return snapshots.relocalise(target, at, wait_s, as_json)


@click.command()
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), default=Path("record.mcap"))
@click.option("--seconds", type=click.FloatRange(0.1), help="Stop after this long (default: at Ctrl-C).")
@click.option(
    "--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="irsd.yaml with the topics."
)
@json_option
@click.pass_obj
def record(target: Target, output: Path, seconds: float | None, config: Path | None, as_json: bool) -> int:
    """Record the sensor topics and the graph's deltas (MCAP)."""
    from irsd.ctl import records

    return records.record(target, output, seconds, config, as_json)


@click.command()
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), default=Path("bundle.zip"))
@click.pass_obj
def bundle(target: Target, output: Path) -> int:
    """Pack what irsd took in lately (record.rolling_mb), its settings, versions and faults; irsctl replay reproduces it."""
    from irsd.ctl import records

    return records.bundle(target, output)


KEEPING: tuple[click.Command, ...] = (snapshot, export, import_, map_, relocalise, record, bundle)
