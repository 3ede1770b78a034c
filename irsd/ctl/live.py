"""irsctl status, tree, show, watch and plan: reading a running irsd."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from irsd.core.runtime import Ring
from irsd.ctl.link import Target, ask, ask_json, connected
from irsd.graph.codec import delta_from_json, snapshot_from_json
from irsd.graph.model import GraphSnapshot, InstanceNode, RoomNode
from irsd.io.messages import Sample


def status(target: Target, as_json: bool) -> int:
    """One status document; exit code 1 when it names faults."""
    with connected(target) as (session, keys):
        document = ask_json(session, keys.status, target.timeout_s)
    click.echo(json.dumps(document) if as_json else "\n".join(status_lines(document)))
    return 1 if document.get("faults") else 0


def status_lines(document: dict[str, Any]) -> list[str]:
    """A status document in words, faults last so that they are on the screen."""
    graph = document.get("graph", {})
    lines = [
        f"{document.get('robot')}: up {document.get('uptime_s', 0):.0f} s, {graph.get('rooms', 0)} rooms, "
        f"{graph.get('instances', 0)} things, revision {graph.get('seq', 0)}, "
        f"cpu {document.get('cpu_cores', 0):.2f} cores, {document.get('rss_mb', 0):.0f} MB"
    ]
    for topic, sensor in document.get("sensors", {}).items():
        age = sensor.get("age_s")
        heard = "never heard" if age is None else f"{sensor.get('rate_hz', 0):5.1f} Hz, {age:.1f} s ago"
        wrong = f", {sensor['bad']} bad ({sensor.get('last_error')})" if sensor.get("bad") else ""
        lost = f", {sensor['dropped']} dropped" if sensor.get("dropped") else ""
        lines.append(f"  {topic:32s} {heard}{lost}{wrong}")
    for stage, times in document.get("stages", {}).items():
        lines.append(f"  {stage:32s} {times.get('p50_ms', 0):6.1f} ms, p95 {times.get('p95_ms', 0):.1f} ms")
    if document.get("blocked_by"):
        lines.append(f"  waiting for {document['blocked_by']}")
    for fault in document.get("faults", []):
        lines += fault_lines(fault)
    for fault in document.get("faults_ended", [])[-3:]:
        lines.append(f"  over: {fault['code']} since {fault['since']}, lasted {fault['for_s']:.0f} s: {fault['text']}")
    return lines


def fault_lines(fault: dict[str, Any]) -> list[str]:
    """A fault in words: what, since when, what it costs, what to do."""
    lines = [f"  FAULT {fault['code']}: {fault['text']} (since {fault['since']}, {fault['for_s']:.0f} s)"]
    return [*lines, f"        effect: {fault['effect']}", f"        do: {fault['remedy']}"]


def tree(target: Target, as_json: bool) -> int:
    """The whole graph."""
    with connected(target) as (session, keys):
        payload = ask(session, keys.snapshot, target.timeout_s)
    click.echo(payload.decode() if as_json else "\n".join(tree_lines(snapshot_from_json(payload))))
    return 0


def tree_lines(snapshot: GraphSnapshot) -> list[str]:
    """building -> rooms -> things; things of no room at the end."""
    by_room: dict[str | None, list[InstanceNode]] = {}
    for thing in snapshot.instances:
        by_room.setdefault(thing.room, []).append(thing)
    lines = [
        f"{snapshot.building.id} {snapshot.building.name}  ({len(snapshot.rooms)} rooms, {len(snapshot.instances)} things)"
    ]
    loose = by_room.get(None, [])
    for index, room in enumerate(snapshot.rooms):
        last_room = index == len(snapshot.rooms) - 1 and not loose
        lines.append(f"{'└──' if last_room else '├──'} {room_line(room, snapshot)}")
        lines += _things(by_room.get(room.id, []), "    " if last_room else "│   ")
    if loose:
        lines.append("└── in no room")
        lines += _things(loose, "    ")
    return lines


def room_line(room: RoomNode, snapshot: GraphSnapshot) -> str:
    """``R3 laboratory  12.4 m², doors to R1, R2``."""
    doors = {door.id: door for door in snapshot.doors}
    beyond = [next(r for r in doors[d].rooms if r != room.id) for d in room.doors if d in doors]
    to = f", doors to {', '.join(sorted(set(beyond), key=lambda r: int(r[1:])))}" if beyond else ""
    return f"{room.id} {room.label}  {room.area_m2:.1f} m²{to}"


def _things(things: list[InstanceNode], indent: str) -> list[str]:
    lines = []
    for index, thing in enumerate(things):
        x, y, z = thing.centroid_m
        branch = "└──" if index == len(things) - 1 else "├──"
        lines.append(
            f"{indent}{branch} {thing.id} {thing.label}  at ({x:.1f}, {y:.1f}, {z:.1f}), seen {thing.observations}x{state_word(thing)}"
        )
    return lines


def state_word(thing: InstanceNode) -> str:
    """`` (gone)`` or `` (moved)``, nothing for what is where it was first found."""
    return "" if thing.state == "present" else f" ({thing.state})"


def show(target: Target, node_id: str, as_json: bool) -> int:
    """One node by its id; exit code 4 if there is none."""
    kinds = {"B": "building", "R": f"rooms/{node_id}", "I": f"instances/{node_id}"}
    if node_id[:1] not in kinds or not node_id[1:].isdigit():
        raise click.UsageError(f"{node_id!r} is no node id: B0, R3 and I7 are")
    with connected(target) as (session, keys):
        replies = [r for r in session.get(keys.key(f"graph/{kinds[node_id[0]]}"), timeout_s=target.timeout_s) if r.ok]
    if not replies:
        click.echo(f"no node {node_id}: irsctl tree lists them", err=True)
        return 4
    document = json.loads(replies[0].payload)
    if as_json:
        click.echo(json.dumps(document))
    else:
        for name, value in document.items():
            click.echo(f"{name:18s} {_short(value)}")
    return 0


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 100 else text[:97] + "..."


def watch(target: Target, as_json: bool, count: int | None) -> int:
    """Deltas until interrupted, or ``count`` of them."""
    with connected(target) as (session, keys):
        deltas: Ring[Sample] = Ring(1024)
        with session.subscribe_history(keys.delta, deltas):
            seen = 0
            while count is None or seen < count:
                sample = deltas.get(timeout_s=0.5)
                if sample is None:
                    continue
                seen += 1
                click.echo(sample.payload.decode() if as_json else delta_line(sample.payload))
    return 0


def delta_line(payload: bytes) -> str:
    """``#41  ~R2 office  ~I7 television  ~I8 chair (gone)  -I9  (R4 split into R4, R9)``."""
    delta = delta_from_json(payload)
    parts = [f"~{room.id} {room.label}" for room in delta.rooms]
    parts += [f"~{thing.id} {thing.label}{state_word(thing)}" for thing in delta.instances]
    parts += [f"~{door.id}" for door in delta.doors] + [f"-{node_id}" for node_id in delta.removed]
    words = f"  ({'; '.join(delta.lineage)})" if delta.lineage else ""
    return f"#{delta.seq}  {'  '.join(parts)}{words}"


def plan(target: Target, output: Path, as_json: bool) -> int:
    """The graph over its plan as svg or png, by the file's ending."""
    from irsd.core.grid import GridFrame
    from irsd.ctl.draw import draw_graph, to_png, to_svg
    from irsd.graph.codec import png_to_occupancy

    if output.suffix not in (".svg", ".png"):
        raise click.UsageError(f"{output}: the name must end in .svg or .png")
    with connected(target) as (session, keys):
        snapshot = snapshot_from_json(ask(session, keys.snapshot, target.timeout_s))
        replies = [r for r in session.get(keys.occupancy, timeout_s=target.timeout_s) if r.ok and r.attachment]
    background = None
    if replies:
        cells = png_to_occupancy(replies[0].payload)
        placed = json.loads(replies[0].attachment or b"{}")
        x, y = placed["origin_xy_m"]
        background = (GridFrame((x, y), placed["resolution_m"], *cells.shape), cells)
    drawing = draw_graph(snapshot, background)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(to_png(drawing) if output.suffix == ".png" else to_svg(drawing).encode())
    done = {
        "file": str(output),
        "seq": snapshot.seq,
        "rooms": len(snapshot.rooms),
        "instances": len(snapshot.instances),
    }
    click.echo(json.dumps(done) if as_json else f"wrote {output}")
    return 0
