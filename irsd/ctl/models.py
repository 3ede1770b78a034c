"""irsctl models: what networks there are, fetching them, checking them, and making them smaller without making them worse."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from irsd.core.errors import ModelError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from irsd.perception.assemble import ModelSettings
    from irsd.perception.catalogue import Model, ModelFile
    from irsd.perception.shelf import Shelf

NOT_FOUND, UNREACHABLE, REFUSED = 4, 5, 7
_PICTURES = (".png", ".jpg", ".jpeg", ".ppm", ".bmp", ".webp")


def complete_names(context: click.Context, _: click.Parameter, incomplete: str) -> list[str]:
    """Names of models for the shell."""
    from irsd.perception.catalogue import load_catalogue

    folder = context.params.get("folder")
    try:
        return [name for name in load_catalogue(folder) if name.startswith(incomplete)]
    except ModelError:
        return []


folder_option = click.option(
    "--dir",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    is_eager=True,
    help="Folder of the models (default: models.directory of irsd.yaml).",
)
name_argument = click.argument("name", shell_complete=complete_names)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


@click.group()
def models() -> None:
    """Networks for irsd's own eyes: list, pull, check, quantise.

    Exit codes: 0 done, 1 error, 2 wrong usage, 4 no such model, 5 can't be fetched, 7 refused.
    """


@models.command("list")
@folder_option
@json_option
def list_(folder: Path | None, as_json: bool) -> int:
    """Every model that is known, its licence, and which of its files are here."""
    from irsd.perception.catalogue import load_catalogue
    from irsd.perception.shelf import Shelf

    settings = _settings(folder)
    shelf = Shelf(settings.folder)
    rows = [_row(shelf, model) for model in load_catalogue(settings.folder).values()]
    if as_json:
        click.echo(json.dumps({"directory": str(settings.folder), "models": rows}))
        return 0
    head = ("name", "roles", "licence", "here", "CPU ms fp32/int8")
    table = [head, *((r["name"], ", ".join(r["roles"]), r["licence"], _here(r), _cost(r)) for r in rows)]
    widths = [max(len(row[k]) for row in table) for k in range(len(head))]
    for row in table:
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    click.echo(f"\nfolder: {settings.folder}")
    return 0


@models.command("pull")
@name_argument
@folder_option
@click.option("--from", "base", default="", metavar="FOLDER|URL", help="Take the files from here, by their own names.")
@click.option(
    "--sha256", "given", multiple=True, metavar="PART=HEX", help="What a file must be that has no known sha256."
)
@click.option("--trust-first-use", is_flag=True, help="Pin files without a known sha256 to what comes now.")
@json_option
def pull_(
    name: str,
    folder: Path | None,
    base: str,
    given: tuple[str, ...],
    trust_first_use: bool,
    as_json: bool,
) -> int:
    """Fetch the files of NAME (fp32, where there is that) or NAME@int8, check them, put them in their place.

    Goes on where it broke off.
    """
    from irsd.perception.shelf import Shelf
    from irsd.perception.supply.pull import pull

    settings = _settings(folder)

    def work() -> list[dict[str, Any]]:
        model, precision = _model(settings, name)
        model.check_licence(settings.accepted)
        out = []
        with _Bars(hidden=as_json) as bars:
            for each in pull(
                Shelf(settings.folder),
                model,
                precision=precision,
                base=base,
                trust_first_use=trust_first_use,
                given=dict(_pins(given)),
                progress=bars.show,
            ):
                bars.end()
                row = {"part": each.file.part, "path": str(each.path), "how": each.how}
                out.append(row | {"sha256": each.sha256, "size_bytes": each.size_bytes})
                if not as_json:
                    click.echo(f"{each.how:8} {each.size_bytes / 1e6:7.1f} MB  {each.sha256[:12]}  {each.path}")
        return out

    return _answer(work, as_json, lambda rows: json.dumps({"model": name, "files": rows}), lambda _: None)


@models.command("check")
@name_argument
@folder_option
@json_option
def check_(name: str, folder: Path | None, as_json: bool) -> int:
    """Load NAME (or NAME@int8), hold it to its contract, measure it at 1 and 2 threads. Exit code 7 when it breaks the contract."""
    from irsd.perception.supply import RefusedError
    from irsd.perception.supply.check import check

    settings = _settings(folder)

    def work() -> list[dict[str, Any]]:
        _model(settings, name)
        reports = [dataclasses.asdict(check(settings, name, threads)) for threads in (1, 2)]
        problems = list(dict.fromkeys(problem for report in reports for problem in report["problems"]))
        if problems and not as_json:
            raise RefusedError("\n  ".join([f"{name} breaks its contract:", *problems]))
        return reports

    def text(reports: list[dict[str, Any]]) -> None:
        click.echo("part       precision  threads  calls  wall ms   CPU ms")
        for report in reports:
            for cost in report["costs"]:
                precision = report["precisions"].get(cost["part"], "")
                click.echo(
                    f"{cost['part']:9}  {precision:9}  {report['threads']:7}  {cost['calls']:5}"
                    f"  {cost['wall_ms']:7.1f}  {cost['cpu_ms']:7.1f}"
                )
        one, two = reports
        click.echo(
            f"{name} keeps its contract; opens in {one['open_s']:.1f} s, "
            f"holds {one['rss_mb']:.0f} MB ({two['rss_mb']:.0f} on two threads), peak {one['peak_mb']:.0f} MB"
        )

    code = _answer(work, as_json, lambda reports: json.dumps({"model": name, "reports": reports}), text)
    return code


@models.command("quantise")
@name_argument
@click.option(
    "--frames",
    type=click.Path(exists=True, path_type=Path),
    required=True,
    help="What the robot sees: a recording (.mcap), a picture, or a folder of pictures.",
)
@click.option("--count", default=16, show_default=True, type=click.IntRange(1, 1000), help="How many pictures of it.")
@click.option("--part", "parts", multiple=True, help="Only this part (default: all that have a recipe).")
@folder_option
@json_option
def quantise_(name: str, frames: Path, count: int, parts: tuple[str, ...], folder: Path | None, as_json: bool) -> int:
    """Make int8 of NAME from its fp32 files, and use it if it passes the accuracy gate. Exit code 7 when the gate refuses it."""
    from irsd.perception.supply.quantise import describe, quantise

    settings = _settings(folder)

    def say(text: str) -> None:
        if not as_json:
            click.echo(f"  {text}", err=True)

    def work() -> list[dict[str, Any]]:
        _model(settings, name)
        pictures = read_pictures(frames, count)
        say(f"{len(pictures)} pictures of {frames}")
        out = []
        for outcome in quantise(settings, name, pictures, parts=parts, say=say):
            out.append(describe(outcome))
            if not as_json:
                sizes = f"{outcome.float_bytes / 1e6:.1f} -> {outcome.int8_bytes / 1e6:.1f} MB"
                click.echo(f"{outcome.part}: {sizes}, passed: {outcome.verdict}")
        return out

    return _answer(work, as_json, lambda rows: json.dumps({"model": name, "parts": rows}), lambda _: None)


# ------------------------------------------------------------------------------------------------------------- helpers
def read_pictures(source: Path, count: int) -> list[NDArray[np.uint8]]:
    """Up to ``count`` RGB pictures uint8 [H, W, 3], spread evenly over a recording or a folder. ModelError when there are none."""
    if source.suffix == ".mcap":
        found = list(_recorded(source, count))
    else:
        files = [source] if source.is_file() else sorted(p for p in source.iterdir() if p.suffix.lower() in _PICTURES)
        step = max(len(files) / count, 1.0)
        found = [_picture(files[int(k * step)]) for k in range(min(count, len(files)))]
    if not found:
        raise ModelError(
            f"{source} has no pictures: give a recording with a camera, a picture, or a folder of pictures"
        )
    return found


def _recorded(source: Path, count: int) -> Iterator[NDArray[np.uint8]]:
    import numpy as np

    from irsd.sensors.decode import KINDS
    from irsd.sensors.replay import read_messages, topics_of

    decoders: dict[str, Callable[[bytes], Any]] = {
        kind.type_name: kind.decode for kind in (KINDS["image"], KINDS["image_compressed"])
    }
    kinds = {topic: decoders[kind] for topic, kind in topics_of(source).items() if kind in decoders}
    total = sum(1 for _ in read_messages(source, kinds))
    step, due = max(total / count, 1.0), 0.0
    for number, message in enumerate(read_messages(source, kinds)):
        if number >= due:
            due += step
            (image,) = kinds[message.topic](message.data)
            yield np.ascontiguousarray(image.bgr[..., ::-1])


def _picture(file: Path) -> NDArray[np.uint8]:
    import numpy as np

    from irsd.core.errors import DecodeError
    from irsd.sensors.pictures import bgr_of_file

    try:
        return np.ascontiguousarray(bgr_of_file(np.frombuffer(file.read_bytes(), np.uint8))[..., ::-1])
    except (OSError, DecodeError) as error:
        raise ModelError(f"{file} is no picture: {error}") from error


class _Bars:
    """One progress bar at a time, on stderr."""

    def __init__(self, hidden: bool) -> None:
        self._hidden = hidden or not sys.stderr.isatty()
        self._bar: Any = None
        self._file = ""

    def show(self, file: str, done: int, total: int | None) -> None:
        if self._hidden or total is None:
            return
        if file != self._file:
            self.end()
            self._bar = click.progressbar(length=total, label=file, file=sys.stderr)
            self._bar.__enter__()
            self._file = file
        self._bar.update(done - self._bar.pos)

    def end(self) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
        self._bar, self._file = None, ""

    def __enter__(self) -> _Bars:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


def _answer(
    work: Callable[[], list[dict[str, Any]]],
    as_json: bool,
    document: Callable[[list[dict[str, Any]]], str],
    text: Callable[[list[dict[str, Any]]], None],
) -> int:
    """Does the work, prints what came of it, and turns refusals into exit codes."""
    from irsd.perception.supply import RefusedError, UnreachableError

    try:
        rows = work()
    except ModelError as error:
        code = {RefusedError: REFUSED, UnreachableError: UNREACHABLE, _UnknownError: NOT_FOUND}.get(type(error), 1)
        if as_json:
            click.echo(json.dumps({"error": str(error), "exit_code": code}))
        else:
            click.echo(f"irsctl: {error}", err=True)
        return code
    if as_json:
        click.echo(document(rows))
    else:
        text(rows)
    return REFUSED if any(row.get("problems") for row in rows) else 0


class _UnknownError(ModelError):
    """No model has this name."""


def _model(settings: ModelSettings, name: str) -> tuple[Model, str]:
    from irsd.perception.catalogue import find_model, load_catalogue

    catalogue = load_catalogue(settings.folder)
    try:
        return find_model(catalogue, name)
    except ModelError as error:
        raise _UnknownError(str(error)) from error


def _settings(folder: Path | None) -> ModelSettings:
    from irsd.config import find_config, load_config

    settings = load_config(find_config(None)).models
    return settings if folder is None else dataclasses.replace(settings, directory=str(folder))


def _pins(given: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    for text in given:
        part, _, digits = text.partition("=")
        if not part or len(digits) != 64 or set(digits.lower()) - set("0123456789abcdef"):
            raise click.UsageError(f"--sha256 {text}: must be PART=64 hexadecimal digits")
        yield part, digits.lower()


def _row(shelf: Shelf, model: Model) -> dict[str, Any]:
    """A model as plain values."""
    files = [_file_row(shelf, model, file) for part in model.parts for file in shelf.files_of(model, part)]
    costs = {part: dataclasses.asdict(cost) for part, cost in model.costs.items()}
    return {
        **{key: getattr(model, key) for key in ("name", "title", "roles", "family", "licence", "permissive", "source")},
        **{"note": model.note, "files": files, "cost": costs, "floors": dict(model.floors)},
    }


def _file_row(shelf: Shelf, model: Model, file: ModelFile) -> dict[str, Any]:
    record = shelf.record(model, file)
    return {
        "part": file.part,
        "precision": file.precision,
        "name": file.local_name,
        "here": shelf.present(model, file),
        "pinned": shelf.pin(model, file) is not None,
        "judged": record.judged if record is not None else {},
    }


def _here(row: dict[str, Any]) -> str:
    """Such as ``fp32, int8*``: precisions in which all parts are here; the star: judged on this machine."""
    networks = [file for file in row["files"] if file["precision"]]
    parts = {file["part"] for file in networks}
    words = []
    for precision in dict.fromkeys(file["precision"] for file in networks):
        here = [file for file in networks if file["precision"] == precision and file["here"]]
        if {file["part"] for file in here} == parts:
            words.append(precision + ("*" if all(file["judged"] for file in here) else ""))
        elif here:
            words.append(f"({precision} {', '.join(file['part'] for file in here)})")
    return ", ".join(words) or "-"


def _cost(row: dict[str, Any]) -> str:
    parts = []
    for cost in row["cost"].values():
        parts.append("/".join("?" if ms is None else f"{ms:.0f}" for ms in cost["cpu_ms"]))
    return " + ".join(parts)
