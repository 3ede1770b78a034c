"""Fetching models from a real HTTP server: broken connections, changed files, wrong bytes, no network."""

from __future__ import annotations

import hashlib
import http.server
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from irsd.core.errors import ModelError
from irsd.perception.catalogue import Model, parse_catalogue
from irsd.perception.shelf import Record, Shelf
from irsd.perception.supply import RefusedError, UnreachableError
from irsd.perception.supply.pull import Pulled, pull

CONTENT = np.random.default_rng(0).bytes(3_000_000)
TOKENS = b"{}"


@dataclass
class Shop:
    """What the server has, and how it behaves. asked: the Range header of each request for the network ('' without)."""

    content: bytes = CONTENT
    version: str | None = '"v1"'
    break_after: int | None = None
    error: int | None = None
    asked: list[str] = field(default_factory=list)
    base: str = ""


class Handler(http.server.BaseHTTPRequestHandler):
    """Range and If-Range as RFC 9110 has them."""

    shop: Shop

    def do_GET(self) -> None:
        shop = self.shop
        if self.path == "/tokenizer.json":
            self.answer(200, TOKENS, len(TOKENS))
            return
        if self.path == "/moved/model.onnx":
            self.send_response(302)
            self.send_header("Location", "/model.onnx")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        wanted = self.headers.get("Range", "")
        shop.asked.append(wanted)
        if shop.error:
            self.send_error(shop.error)
            return
        begin = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        if begin >= len(shop.content) and begin:
            self.send_error(416)
            return
        whole = not wanted or self.headers.get("If-Range") != shop.version
        body = shop.content if whole else shop.content[begin:]
        sent = body if shop.break_after is None else body[: shop.break_after]
        shop.break_after = None
        self.answer(200 if whole else 206, sent, len(body), begin)

    def answer(self, status: int, sent: bytes, length: int, begin: int = 0) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(length))
        if self.shop.version:
            self.send_header("ETag", self.shop.version)
        if status == 206:
            self.send_header("Content-Range", f"bytes {begin}-{begin + length - 1}/{begin + length}")
        self.end_headers()
        self.wfile.write(sent)  # shorter than announced when the connection is to break

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def shop() -> Iterator[Shop]:
    here = Shop()
    handler = type("ShopHandler", (Handler,), {"shop": here})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        here.base = f"http://127.0.0.1:{server.server_address[1]}"
        yield here
        server.shutdown()
        thread.join()


def model_of(sha256: str | None = None, base: str = "https://models.invalid/", licence: str = "MIT") -> Model:
    entry = {
        "title": "A model",
        "roles": ["detector"],
        "family": "owl",
        "licence": licence,
        "source": "https://models.invalid",
        "base": base,
        "files": {
            "model": {"fp32": {"path": "onnx/model.onnx", "sha256": sha256}},
            "tokenizer": {"path": "tokenizer.json", "sha256": hashlib.sha256(TOKENS).hexdigest()},
        },
        "contract": {"model": {"inputs": {}, "outputs": {}}},
    }
    return parse_catalogue({"schema": 1, "models": {"m": entry}})["m"]


SHA256 = hashlib.sha256(CONTENT).hexdigest()
PINNED = model_of(SHA256)


def pulled(shelf: Shelf, shop: Shop, model: Model = PINNED, **options: object) -> list[Pulled]:
    return list(pull(shelf, model, base=shop.base, pauses_s=(), **options))  # type: ignore[arg-type]


def test_files_come_with_progress_and_are_checked(shop: Shop, tmp_path: Path) -> None:
    steps: list[tuple[str, int, int | None]] = []
    shelf = Shelf(tmp_path)
    network, tokenizer = pulled(shelf, shop, progress=lambda *step: steps.append(step))
    assert (network.how, network.sha256, network.size_bytes) == ("fetched", SHA256, len(CONTENT))
    assert network.path == tmp_path / "m" / "model.fp32.onnx"
    assert network.path.read_bytes() == CONTENT
    assert tokenizer.path.read_bytes() == TOKENS
    assert steps[-2] == ("model.fp32.onnx", len(CONTENT), len(CONTENT))
    assert sorted(p.name for p in (tmp_path / "m").iterdir()) == ["model.fp32.onnx", "tokenizer.json"]
    assert [each.how for each in pulled(shelf, shop)] == ["here", "here"]
    assert len(shop.asked) == 1


def test_an_interrupted_download_goes_on_where_it_broke_off(shop: Shop, tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    shop.break_after = 2_000_000
    with pytest.raises(UnreachableError, match=r"broke off after 2000000 of 3000000 bytes(.|\n)*goes on from there"):
        pulled(shelf, shop)
    assert (tmp_path / "m" / "model.fp32.onnx.part").stat().st_size == 2_000_000
    assert not (tmp_path / "m" / "model.fp32.onnx").exists()
    steps: list[int] = []
    assert pulled(shelf, shop, progress=lambda _, done, __: steps.append(done))[0].path.read_bytes() == CONTENT
    assert shop.asked == ["", "bytes=2000000-"]
    assert steps[0] > 2_000_000


def test_a_redirected_download_goes_on_too(shop: Shop, tmp_path: Path) -> None:
    shelf, moved = Shelf(tmp_path), f"{shop.base}/moved"
    shop.break_after = 2_000_000
    with pytest.raises(UnreachableError):
        list(pull(shelf, PINNED, base=moved, pauses_s=()))
    assert next(pull(shelf, PINNED, base=moved, pauses_s=())).path.read_bytes() == CONTENT
    assert shop.asked == ["", "bytes=2000000-"]


def test_a_broken_connection_is_tried_again_by_itself(shop: Shop, tmp_path: Path) -> None:
    shop.break_after = 1_000_000
    (network, _) = pull(Shelf(tmp_path), PINNED, base=shop.base, pauses_s=(0.0,))
    assert network.path.read_bytes() == CONTENT
    assert shop.asked == ["", "bytes=1000000-"]


@pytest.mark.parametrize("version", ['"v2"', None])
def test_a_file_that_changed_meanwhile_is_fetched_anew(shop: Shop, tmp_path: Path, version: str | None) -> None:
    shelf = Shelf(tmp_path)
    shop.content, shop.break_after, shop.version = CONTENT[::-1], 1_500_000, '"v1"' if version else None
    with pytest.raises(UnreachableError):
        pulled(shelf, shop)
    shop.content, shop.version = CONTENT, version
    assert pulled(shelf, shop)[0].path.read_bytes() == CONTENT
    assert shop.asked[-1] == ("bytes=1500000-" if version else "")


def test_more_here_than_there_is_fetched_anew(shop: Shop, tmp_path: Path) -> None:
    part = tmp_path / "m" / "model.fp32.onnx.part"
    part.parent.mkdir()
    part.write_bytes(CONTENT + b"tail")
    part.with_name(part.name + ".version").write_text('"v1"')
    (network, _) = pull(Shelf(tmp_path), PINNED, base=shop.base, pauses_s=(0.0,))
    assert network.path.read_bytes() == CONTENT


def test_a_wrong_sha256_is_refused_and_thrown_away(shop: Shop, tmp_path: Path) -> None:
    shop.content = CONTENT[:-1] + b"\0"
    with pytest.raises(RefusedError, match=rf"has sha256 \w+, expected {SHA256}: it was thrown away"):
        pulled(Shelf(tmp_path), shop)
    assert not list((tmp_path / "m").iterdir())
    shop.content = CONTENT
    assert pulled(Shelf(tmp_path), shop)[0].sha256 == SHA256


def test_an_unknown_sha256_needs_consent_or_a_word(shop: Shop, tmp_path: Path) -> None:
    shelf, unpinned = Shelf(tmp_path / "models"), model_of(None)
    with pytest.raises(RefusedError, match=r"--sha256 model=HEX, or say --trust-first-use"):
        pulled(shelf, shop, unpinned)
    with pytest.raises(RefusedError, match="without https only what has a known sha256"):
        pulled(shelf, shop, unpinned, trust_first_use=True)
    assert shop.asked == []
    with pytest.raises(RefusedError, match="expected " + "0" * 64):
        pulled(shelf, shop, unpinned, given={"model": "0" * 64})
    shop.version = '"v2"'
    assert pulled(shelf, shop, unpinned, given={"model": SHA256})[0].how == "fetched"
    assert [each.how for each in pulled(shelf, shop, unpinned)] == ["here", "here"]


def test_what_was_trusted_once_is_held_to_it(tmp_path: Path) -> None:
    folder, shelf, unpinned = tmp_path / "stick", Shelf(tmp_path / "models"), model_of(None)
    folder.mkdir()
    (folder / "model.onnx").write_bytes(CONTENT)
    (folder / "tokenizer.json").write_bytes(TOKENS)
    (network, _) = pull(shelf, unpinned, base=str(folder), trust_first_use=True)
    assert (network.how, network.sha256) == ("fetched", SHA256)
    record = shelf.record(unpinned, network.file)
    assert record is not None
    assert (record.sha256, record.origin) == (SHA256, (folder / "model.onnx").as_uri())
    assert shelf.verified(unpinned, network.file) == network.path
    network.path.write_bytes(CONTENT[::-1])
    with pytest.raises(ModelError, match="was altered"):
        shelf.verified(unpinned, network.file)
    (folder / "model.onnx").write_bytes(CONTENT[::-1])
    network.path.unlink()
    with pytest.raises(RefusedError, match=f"expected {SHA256}"):
        list(pull(shelf, unpinned, base=folder.as_uri(), trust_first_use=True))


def test_what_was_put_there_by_hand(tmp_path: Path) -> None:
    shelf, unpinned = Shelf(tmp_path), model_of(None)
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "model.fp32.onnx").write_bytes(CONTENT)
    (tmp_path / "m" / "tokenizer.json").write_bytes(TOKENS)
    file = unpinned.files[0]
    with pytest.raises(ModelError, match=r"no known checksum.*--trust-first-use"):
        shelf.verified(unpinned, file)
    assert [each.how for each in pull(shelf, unpinned, trust_first_use=True)] == ["pinned", "here"]
    assert shelf.record(unpinned, file) == Record(SHA256, len(CONTENT), "put there by hand")
    assert shelf.verified(unpinned, file).is_file()


def test_no_network_says_what_to_fetch_and_where_to_put_it(tmp_path: Path) -> None:
    with socket.socket() as taken:  # bound but not listening: connections are refused
        taken.bind(("127.0.0.1", 0))
        base = f"http://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(UnreachableError) as failed:
            list(pull(Shelf(tmp_path), PINNED, base=base, pauses_s=()))
    for word in (f"{base}/model.onnx", "refused", SHA256, str(tmp_path / "m" / "model.fp32.onnx"), "--from FOLDER"):
        assert word in str(failed.value)
    with pytest.raises(UnreachableError, match=r"can't be read: No such file"):
        list(pull(Shelf(tmp_path), PINNED, base=str(tmp_path / "nowhere")))


def test_the_server_says_no(shop: Shop, tmp_path: Path) -> None:
    shop.error = 404
    with pytest.raises(UnreachableError, match=r"the server says 404"):
        pulled(Shelf(tmp_path), shop)
    shop.error = 503
    with pytest.raises(UnreachableError, match=r"the server says 503"):
        list(pull(Shelf(tmp_path), PINNED, base=shop.base, pauses_s=(0.0,)))
    assert len(shop.asked) == 3, "404 is final, 503 is tried again"


def test_files_that_nobody_publishes(tmp_path: Path) -> None:
    own = model_of(SHA256, base="")
    with pytest.raises(UnreachableError, match=r"nobody is known to publish model.onnx; get it from https://models"):
        list(pull(Shelf(tmp_path), own))
    with pytest.raises(ModelError, match="has no int8 of model to fetch, only fp32"):
        list(pull(Shelf(tmp_path), own, precision="int8"))


def test_files_of_a_python_package_are_used_where_they_are(tmp_path: Path) -> None:
    from irsd.perception.catalogue import load_catalogue

    weights, vocabulary = pull(Shelf(tmp_path), load_catalogue()["minilm-l6-v2"])
    assert (weights.how, weights.path.name) == ("here", "model.onnx")
    assert vocabulary.path.is_file()
    assert not list(tmp_path.iterdir())
