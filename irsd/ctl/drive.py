"""irsctl goto and cancel: send a goal to nav_bridge, follow it to its end."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import click

from irsd.core.runtime import Ring, monotonic_s
from irsd.ctl.link import Target, ask_json, connected
from irsd.io.messages import Sample

EXIT_BY_STATUS = {"resolved": 0, "accepted": 0, "ambiguous": 3, "not_found": 4, "unreachable": 5}
FINAL_STATES = {"reached": 0, "failed": 6, "cancelled": 6, "preempted": 6}
PROGRESS_S = 3.0
SILENCE_S = 15.0  # nav_bridge reports at 1 Hz or more while it drives


def goto(target: Target, query: str, within_m: float | None, priority: int, no_wait: bool, as_json: bool) -> int:
    """Resolve, drive, and say how it ended."""
    code, document = go(target, query, within_m, priority, wait=not no_wait, quiet=as_json)
    if as_json:
        click.echo(json.dumps(document))
    return code


def go(
    target: Target,
    query: str,
    within_m: float | None = None,
    priority: int = 0,
    *,
    wait: bool = True,
    quiet: bool = False,
) -> tuple[int, dict[str, Any]]:
    """(exit code, the answer document with the final state under ``result``); says how it goes unless quiet."""
    with connected(target) as (session, keys):
        states: Ring[Sample] = Ring(256)
        with session.subscribe(keys.nav("state"), states), session.watch_alive(keys.nav("alive"), states):
            request = {"query": query, "priority": priority} | ({"within_m": within_m} if within_m is not None else {})
            answer = ask_json(session, keys.nav("goto"), max(target.timeout_s, 10.0), request)
            if not quiet:
                click.echo(describe(answer))
            code = EXIT_BY_STATUS.get(str(answer.get("status")), 1)
            if code or not wait:
                return code, answer
            final = follow(states, str(answer["goal_id"]), quiet=quiet)
    return FINAL_STATES.get(str(final.get("state")), 1), {**answer, "result": final}


def follow(states: Ring[Sample], goal_id: str, *, quiet: bool) -> dict[str, Any]:
    """Wait for the end of a goal; prints how it goes unless quiet. Returns the final state document."""
    shown, shown_s, gone = "", 0.0, False
    while True:
        sample = states.get(timeout_s=SILENCE_S)
        if sample is None:
            reason = "nav_bridge has died" if gone else f"no word from nav_bridge for {SILENCE_S:g} s"
            click.echo(f"Failed: {reason}", err=True)
            return {"goal_id": goal_id, "state": "failed", "reason": reason}
        if (
            sample.deleted
        ):  # the token that says nav_bridge lives: the vehicle holds by itself, and its successor goes on
            gone = True
            click.echo("nav_bridge has died or was stopped; the robot holds", err=True)
        if not sample.payload:
            continue
        state: dict[str, Any] = json.loads(sample.payload)
        if state.get("goal_id") != goal_id:
            continue
        phase = str(state.get("state"))
        if not quiet and (phase != shown or monotonic_s() - shown_s >= PROGRESS_S):
            click.echo(str(state.get("text") or phase))
            shown, shown_s = phase, monotonic_s()
        if phase in FINAL_STATES:
            return state


def cancel(target: Target, as_json: bool) -> int:
    """Stop the current goal."""
    with connected(target) as (session, keys):
        answer = ask_json(session, keys.nav("cancel"), target.timeout_s, {})
    click.echo(json.dumps(answer) if as_json else str(answer.get("text", "cancelled")))
    return 0


def describe(answer: dict[str, Any]) -> str:
    """An answer of nav_bridge in words."""
    status, text = answer.get("status"), answer.get("text")
    if text:
        return str(text)
    goal = answer.get("target") or {}
    if status == "resolved":
        approach = answer.get("approach") or {}
        name = f"{goal.get('instance')} {goal.get('label')} in {goal.get('room')}"
        return f"Going to {name}: stopping {approach.get('distance_to_target_m', float('nan')):.2f} m from it"
    found = ", ".join(
        str(c.get("instance")) + " " + str(c.get("label")) for c in answer.get("candidates", []) if isinstance(c, dict)
    )
    return f"{str(status).replace('_', ' ')}" + (f": {found}" if found else "")


def goto_offline(
    folder: Path, query: str | None, queries: Path | None, start: str | None, within_m: float | None, as_json: bool
) -> int:
    """Answers from a replay's folder. nav_bridge is another program: it is run, not imported."""
    command = [sys.executable, "-m", "nav_bridge", "offline", str(folder)]
    command += [query] if query is not None else []
    command += ["--queries", str(queries)] if queries is not None else []
    command += ["--from", start] if start is not None else []
    command += ["--within", str(within_m)] if within_m is not None else []
    command += ["--json"] if as_json else []
    return subprocess.run(command, check=False).returncode
