"""Sessions: what is said aloud when a provider is missing, and runs that are told to stop."""

from __future__ import annotations

import logging
import subprocess
import sys

import numpy as np
import pytest

from irsd.core.errors import ModelError, RunCancelledError
from irsd.core.runtime import Event, Worker
from irsd.models import MINILM_WEIGHTS
from irsd.perception.models import Cancel, Session, Tensor, packaged_path


def feeds(rows: int, tokens: int) -> dict[str, np.ndarray]:
    ids = np.full((rows, tokens), 2694, np.int64)
    return {"input_ids": ids, "attention_mask": np.ones_like(ids), "token_type_ids": np.zeros_like(ids)}


@pytest.fixture(scope="module")
def session() -> Session:
    return Session(packaged_path(MINILM_WEIGHTS))


def test_a_session_says_what_goes_in_and_out(session: Session) -> None:
    assert Tensor("input_ids", "int64", ("batch", "sequence")) in session.input_tensors
    assert [tensor.dtype for tensor in session.output_tensors] == ["float32"]
    assert session.providers == ("cpu",)
    assert session.fallback == ""


def test_a_missing_provider_is_said_aloud(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        fallen = Session(packaged_path(MINILM_WEIGHTS), providers=("tensorrt", "cpu"))
    assert fallen.providers == ("cpu",)
    assert fallen.fallback == "tensorrt not available, runs on cpu"
    assert "tensorrt not available, runs on cpu" in caplog.text
    with pytest.raises(ModelError, match="unknown execution provider abacus; known are tensorrt, cuda"):
        Session(packaged_path(MINILM_WEIGHTS), providers=("abacus",))


def test_a_cancelled_run_does_not_start_until_cleared(session: Session) -> None:
    cancel = Cancel()
    cancel.request()
    with pytest.raises(RunCancelledError, match="told to stop"):
        session.run(feeds(1, 4), ("last_hidden_state",), cancel)
    cancel.clear()
    (hidden,) = session.run(feeds(1, 4), ("last_hidden_state",), cancel)
    assert hidden.shape == (1, 4, 384)


def test_a_run_in_flight_ends_when_told_and_the_session_lives_on(session: Session) -> None:
    cancel, begun, outcome = Cancel(), Event(), []

    def work() -> None:
        begun.set()
        try:
            session.run(feeds(64, 256), ("last_hidden_state",), cancel)  # tens of seconds, were it left alone
        except RunCancelledError:
            outcome.append("cancelled")

    worker = Worker("long run", work).start()
    assert begun.wait(10)
    cancel.request()
    assert worker.join(60)
    assert outcome == ["cancelled"]
    cancel.clear()
    assert session.run(feeds(1, 3), ("last_hidden_state",), cancel)[0].shape == (1, 3, 384)
    with pytest.raises(ModelError, match="failed"):
        session.run({"input_ids": np.zeros((1, 2), np.float32)}, ("last_hidden_state",), cancel)


def test_quantising_without_its_package_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['onnx'] = None\n"
        "from irsd.core.errors import ModelError\n"
        "from irsd.perception.models import quantisation_tools\n"
        "try: quantisation_tools()\n"
        "except ModelError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install 'irsd[quantise]'" in done.stdout
