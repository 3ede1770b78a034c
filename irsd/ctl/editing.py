"""The commands of irsctl that change the graph by hand, and their options; what they do is in ``edits``, imported when one runs."""

from __future__ import annotations

import click

from irsd.ctl.link import Target

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="[ID] NAME")
@click.option("--room", metavar="ID", help="Name this room instead of a thing.")
@json_option
@click.pass_obj
def teach(target: Target, words: tuple[str, ...], room: str | None, as_json: bool) -> int:
    """Say what a thing is: teach I7 "centrifuge"; or a room: teach --room R3 "room 315".

    Your word outranks what irsd sees, survives restarts, and serves as an example for the next such thing.
    """
    from irsd.ctl import edits as doing

    wanted = 1 if room else 2
    if len(words) != wanted:
        raise click.UsageError('teach I7 "centrifuge", or teach --room R3 "room 315"')
    return doing.edit(target, as_json, "teach", room or words[0], words[-1])


@click.command()
@click.argument("node_id", metavar="ID")
@click.argument("name")
@json_option
@click.pass_obj
def rename(target: Target, node_id: str, name: str, as_json: bool) -> int:
    """Call one thing or room NAME, without making it an example for others."""
    from irsd.ctl import edits as doing

    return doing.edit(target, as_json, "rename", node_id, name)


@click.command()
@click.argument("node_id", metavar="[ID]", required=False, default="")
@click.option("--name", default="", help="Forget this name wherever it was taught, and its examples.")
@json_option
@click.pass_obj
def forget(target: Target, node_id: str, name: str, as_json: bool) -> int:
    """Take the taught name of a thing or room back."""
    from irsd.ctl import edits as doing

    if bool(node_id) == bool(name):
        raise click.UsageError("forget I7, or forget --name centrifuge")
    return doing.edit(target, as_json, "forget", node_id, name)


@click.command()
@click.argument("ids", nargs=-1, required=True, metavar="ID ID...")
@json_option
@click.pass_obj
def merge(target: Target, ids: tuple[str, ...], as_json: bool) -> int:
    """Make one thing of several; the first keeps its id."""
    from irsd.ctl import edits as doing

    return doing.edit(target, as_json, "merge", ids[0], others=ids[1:])


@click.command()
@click.argument("node_id", metavar="ID")
@json_option
@click.pass_obj
def split(target: Target, node_id: str, as_json: bool) -> int:
    """Make two things of one, at its widest gap; the smaller part gets a new id."""
    from irsd.ctl import edits as doing

    return doing.edit(target, as_json, "split", node_id)


@click.command()
@click.argument("node_id", metavar="ID")
@json_option
@click.pass_obj
def delete(target: Target, node_id: str, as_json: bool) -> int:
    """Take a thing out of the graph that is not there."""
    from irsd.ctl import edits as doing

    return doing.edit(target, as_json, "delete", node_id)


@click.command()
@click.option("--count", default=1, show_default=True, type=click.IntRange(1, 1000), help="So many edits.")
@json_option
@click.pass_obj
def undo(target: Target, count: int, as_json: bool) -> int:
    """Take the last edits back, also those from before a restart."""
    from irsd.ctl import edits as doing

    return doing.undo(target, count, as_json)


@click.command("edits")
@json_option
@click.pass_obj
def edits_command(target: Target, as_json: bool) -> int:
    """List the edits, undone ones too."""
    from irsd.ctl import edits as doing

    return doing.edits(target, as_json)


EDITING: tuple[click.Command, ...] = (teach, rename, forget, merge, split, delete, undo, edits_command)
