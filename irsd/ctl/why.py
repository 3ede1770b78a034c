"""irsctl why and parse: how nav_bridge comes to its answer, in words."""

from __future__ import annotations

import json
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from irsd.core.errors import IrsdError
from irsd.ctl.link import Target, ask_json, connected

_MAX_CANDIDATES = 12


def why(
    target: Target, query: str, offline: Path | None, start: str | None, within_m: float | None, as_json: bool
) -> int:
    """The answer to a goal without driving; exit code 0 whatever the answer is."""
    answer = _offline(offline, query, start, within_m) if offline is not None else _live(target, query, within_m)
    click.echo(json.dumps(answer, ensure_ascii=False) if as_json else "\n".join(why_lines(answer)))
    return 0


def _live(target: Target, query: str, within_m: float | None) -> dict[str, Any]:
    request: dict[str, Any] = {"query": query} | ({"within_m": within_m} if within_m is not None else {})
    with connected(target) as (session, keys):
        return ask_json(session, keys.nav("why"), max(target.timeout_s, 10.0), request)


def _offline(folder: Path, query: str, start: str | None, within_m: float | None) -> dict[str, Any]:
    """nav_bridge is another program: it is run, not imported. Its exit code tells the answer's status, which is no error here."""
    command = [sys.executable, "-m", "nav_bridge", "offline", str(folder), query, "--json"]
    command += ["--from", start] if start is not None else []
    command += ["--within", str(within_m)] if within_m is not None else []
    done = subprocess.run(command, check=False, stdout=subprocess.PIPE, text=True)
    if done.returncode in (1, 2):
        raise IrsdError("nav_bridge could not answer")
    return dict(json.loads(done.stdout))


def parse(query: str, as_json: bool) -> int:
    """What a sentence is understood to say."""
    command = [sys.executable, "-m", "nav_bridge", "parse", query] + (["--json"] if as_json else [])
    return subprocess.run(command, check=False).returncode


def why_lines(answer: dict[str, Any]) -> list[str]:
    """An answer document (docs/schema/nav_answer.json) in words: understood, rooms, candidates, places, way."""
    because = answer.get("why", {})
    lines = [f"{answer.get('query')}: {answer.get('text')}", f"understood  {_understood(because.get('parse', {}))}"]
    rooms = because.get("rooms", [])
    if rooms:
        lines.append("rooms       " + ", ".join(f"{r['room']} {r['label']} {r['grade']:.2f}" for r in rooms))
    considered = because.get("considered", [])
    lines.append(f"candidates  {len(considered)}" if considered else "candidates  none")
    lines += [_candidate_line(c) for c in considered[:_MAX_CANDIDATES]]
    asked = [c for c in answer.get("candidates", []) if isinstance(c, dict) and c.get("answer")]
    lines += [f'say "{c["answer"]}" for {c.get("instance") or c.get("room")}' for c in asked[:_MAX_CANDIDATES]]
    tried = because.get("poses_tried", [])
    if tried:
        lines.append("places to stand, best first (m)")
    for pose in tried:
        lines.append(
            f"  ({pose['x']:.2f}, {pose['y']:.2f})  {pose['distance_m']:.2f} from the surface, {pose['clearance_m']:.2f} clear, "
            f"sees {100 * pose['sees']:.0f} %, price {pose['price']:.2f}"
        )
    if "best_distance_m" in because:
        lines.append(f"nearest place that can be reached: {because['best_distance_m']:.2f} m from it")
    if "way_m" in because:
        lines.append(f"way         {because['way_m']:.1f} m in {len(answer.get('waypoints', []))} waypoints")
    return lines


def _understood(parsed: dict[str, Any]) -> str:
    things = [" ".join([*(v for _, v in t["attributes"]), t["name"]]) for t in parsed.get("things", [])]
    parts = [f"{parsed.get('language', '?')}:", " or ".join(things) or "no thing"]
    parts += [f"in {parsed['room']}"] if parsed.get("room") and not parsed.get("room_is_goal") else []
    parts += [f"the room {parsed['room']}"] if parsed.get("room_is_goal") else []
    parts += [f"not in {room}" for room in parsed.get("not_rooms", [])]
    for relation in parsed.get("relations", []):
        no = "not " if relation["negated"] else ""
        parts.append(f"{no}{relation['kind'].replace('_', ' ')} {' and '.join(relation['anchors'])}".strip())
    if parsed.get("choice"):
        rank = f" number {parsed['rank']}" if parsed.get("rank", 1) > 1 else ""
        parts.append(f"choice: {parsed['choice']}{rank}")
    if parsed.get("function"):
        parts.append(f"for: {parsed['function']}")
    return f"{parts[0]} {', '.join(parts[1:])}"


def _candidate_line(candidate: dict[str, Any]) -> str:
    name = f"{candidate.get('instance') or ''} {candidate['label']}".strip()
    line = f"  {candidate.get('evidence', candidate['score']):.2f}  {name} in {candidate.get('room')}: {', '.join(candidate['notes'])}"
    if candidate.get("observations") is not None:
        line += f"; seen {candidate['observations']}x, last {_time(int(candidate['last_seen_ns']))}"
    line += "" if candidate.get("rejected") else f"; chance {100 * candidate['score']:.0f} %"
    return line + (f"; out: {candidate['rejected']}" if candidate.get("rejected") else "")


def _time(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%SZ")
