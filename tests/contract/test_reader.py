"""Goals read by a language model, against a real HTTP server that answers as such servers do, well and badly."""

from __future__ import annotations

import http.server
import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import jsonschema
import pytest

from irsd.core.errors import ConfigError
from irsd.perception.aliases import AliasTable
from nav_bridge.language import parse
from nav_bridge.reader import SCHEMA, Reader, ReaderSettings

NAMES = AliasTable.load()
KEY = "sk-very-secret-4711"
BLANK = {"thing": "", "attributes": [], "room": "", "not_room": "", "relations": [], "choice": "", "rank": 1}


class Server:
    """An OpenAI-compatible server with one fixed answer."""

    def __init__(self) -> None:
        self.requests: list[tuple[str, dict[str, str], dict[str, Any]]] = []
        self.answer: Callable[[], tuple[int, bytes]] = lambda: (500, b"")
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                outer.requests.append((self.path, dict(self.headers), body))
                status, payload = outer.answer()
                self.send_response(status)
                self.send_header("Content-Length", str(len(payload)))
                self.end_headers()
                self.wfile.write(payload)

            def log_message(self, *_: Any) -> None:
                pass

        class Quiet(http.server.ThreadingHTTPServer):
            def handle_error(self, *_: Any) -> None:  # the client has hung up: that is what is tested
                pass

        self.http = Quiet(("127.0.0.1", 0), Handler)
        self.thread = threading.Thread(target=self.http.serve_forever)
        self.thread.start()

    def says(self, form: Any) -> None:
        content = form if isinstance(form, str) else json.dumps(form)
        document = json.dumps({"choices": [{"message": {"role": "assistant", "content": content}}]}).encode()
        self.answer = lambda: (200, document)

    def reader(self, timeout_s: float = 5.0) -> Reader:
        url = f"http://127.0.0.1:{self.http.server_address[1]}/v1"
        return Reader(ReaderSettings(url=url, model="tiny", timeout_s=timeout_s), NAMES)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setenv("NAV_BRIDGE_API_KEY", KEY)
    running = Server()
    yield running
    running.http.shutdown()
    running.http.server_close()
    running.thread.join()


def test_a_sentence_that_the_offline_parser_does_not_know_is_read(server: Server) -> None:
    form = {**BLANK, "thing": "television", "room": "bedroom", "attributes": ["large"]}
    jsonschema.Draft202012Validator(SCHEMA).validate(form)
    server.says(form)
    spec = server.reader().read("pelushkaa vie minut sinne missä telkku on")
    assert (spec.things[0].name, spec.room, spec.parsed_by) == ("television", "bedroom", "model")
    assert spec.things[0].attributes == (("size", "large"),)
    path, headers, body = server.requests[0]
    assert path == "/v1/chat/completions"
    assert headers["Authorization"] == f"Bearer {KEY}"
    assert body["model"] == "tiny"
    assert body["response_format"]["json_schema"]["schema"] == SCHEMA


def test_the_model_may_add_but_not_contradict(server: Server) -> None:
    more = {"kind": "near", "things": ["desk"], "negated": False}
    server.says({**BLANK, "thing": "chair", "relations": [more]})
    spec = server.reader().read("the chair, you know, desk-ish")
    assert [r.kind for r in spec.relations] in (["near"], [])
    server.says({**BLANK, "thing": "dog"})
    spec = server.reader().read("the fridge")
    assert (spec.things[0].name, spec.parsed_by) == ("fridge", "offline: the model named something else")
    server.says({**BLANK, "thing": "refrigerator", "room": "bathroom"})
    spec = server.reader().read("fridge in the kitchen")
    assert (spec.room, spec.parsed_by) == ("kitchen", "offline: the model named another room")
    server.says({**BLANK, "thing": "refrigerator"})
    assert server.reader().read("fridge in the kitchen").room == "kitchen"
    assert server.reader().read("fridge").parsed_by == "model, agreed"


@pytest.mark.parametrize(
    "form",
    [
        "I'd love to help!",
        "[1, 2]",
        {},
        {**BLANK, "thing": 7},
        {**BLANK, "choice": "prettiest", "thing": "chair"},
        {**BLANK, "rank": 0, "thing": "chair"},
        {**BLANK, "thing": "chair", "relations": [{"kind": "married to", "things": ["desk"], "negated": False}]},
        {**BLANK, "thing": "chair", "relations": [{"kind": "near", "things": [], "negated": False}]},
        {**BLANK, "thing": "chair", "relations": 3},
        BLANK,
    ],
)
def test_what_is_not_the_form_is_left_out(server: Server, form: Any, caplog: pytest.LogCaptureFixture) -> None:
    server.says(form)
    with caplog.at_level(logging.DEBUG):
        spec = server.reader().read("red chair")
    assert spec.parsed_by == "offline: no use of the model"
    assert spec.things == parse("red chair", NAMES).things
    assert caplog.records
    assert KEY not in caplog.text


@pytest.mark.parametrize(
    "answer",
    [
        lambda: (401, json.dumps({"error": f"bad key {KEY}"}).encode()),
        lambda: (500, b""),
        lambda: (200, b"not json"),
        lambda: (200, b'{"choices": []}'),
        lambda: (200, b"x" * 200_000),
        lambda: (time.sleep(1.5), (200, b""))[1],
    ],
)
def test_a_server_that_fails_is_done_without(
    server: Server, answer: Callable[[], tuple[int, bytes]], caplog: pytest.LogCaptureFixture
) -> None:
    server.answer = answer
    with caplog.at_level(logging.DEBUG):
        spec = server.reader(timeout_s=0.3).read("red chair")
    assert spec.things == parse("red chair", NAMES).things
    assert len(caplog.records) == 1
    assert KEY not in caplog.text


def test_no_server_at_all() -> None:
    reader = Reader(ReaderSettings(url="http://127.0.0.1:9/v1", timeout_s=0.5), NAMES)
    assert reader.read("red chair").things == parse("red chair", NAMES).things
    assert Reader(ReaderSettings(), NAMES).read("red chair").parsed_by == "offline"
    with pytest.raises(ConfigError, match="url"):
        Reader(ReaderSettings(url="ftp://x"), NAMES)
