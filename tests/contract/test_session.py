"""Sessions on real zenoh, on loopback: they find each other, and each measured trap stays shut."""

from __future__ import annotations

import multiprocessing
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from irsd.core.errors import TransportError
from irsd.core.runtime import Event, Ring, monotonic_s, sleep_s
from irsd.io.endpoints import ZenohSettings, session_config, with_environment
from irsd.io.session import CDR, Query, Role, Sample, Session, open_session

WAIT_S = 20.0


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def until(condition: Callable[[], bool]) -> bool:
    """Whether it comes true before a deadline that only a hang reaches."""
    deadline_s = monotonic_s() + WAIT_S
    while not condition():
        if monotonic_s() > deadline_s:
            return False
        sleep_s(0.01)
    return True


@pytest.fixture
def settings() -> ZenohSettings:
    return ZenohSettings(endpoint=free_endpoint(), connect=())


@pytest.fixture
def opened(settings: ZenohSettings) -> Iterator[Callable[[Role], Session]]:
    with ExitStack() as stack:
        yield lambda role: stack.enter_context(open_session(settings, role))


def linked(*sessions: Session) -> bool:
    return until(lambda: all(session.neighbours() for session in sessions))


# ------------------------------------------------------------------------------------------------- finding each other
def test_a_peer_may_start_before_the_hub(opened: Callable[[Role], Session]) -> None:
    peer, hub = opened("peer"), opened("hub")
    assert linked(peer, hub)


def test_peers_meet_through_the_hub_and_outlive_it(settings: ZenohSettings, opened: Callable[[Role], Session]) -> None:
    one, two = opened("peer"), opened("peer")
    got: Ring[Sample] = Ring(64)
    with open_session(settings, "hub"), one.subscribe("test/a", got):
        assert until(lambda: two.neighbours() == 2 and one.neighbours() == 2)
        assert until(lambda: (two.put("test/a", b"1"), bool(len(got)))[1])
    assert until(lambda: one.neighbours() == 1)  # the hub is gone, the link between the peers is not
    with one.subscribe("test/b", got):
        got.drain()
        assert until(lambda: (two.put("test/b", b"2"), bool(len(got)))[1])
    with open_session(settings, "hub") as back:
        assert linked(back)


def test_a_client_reaches_peers_through_the_hub(opened: Callable[[Role], Session]) -> None:
    peer, hub = opened("peer"), opened("hub")
    peer.queryable("test/q", lambda query: query.reply("test/q", b"from the peer"))
    peer.announce("test/alive")
    assert linked(peer, hub)
    client = opened("client")
    assert until(lambda: [r.payload for r in client.get("test/q")] == [b"from the peer"])
    assert client.find_alive("test/*") == ["test/alive"]


def test_a_client_without_a_hub_says_what_to_do(settings: ZenohSettings) -> None:
    quick = ZenohSettings(endpoint=settings.endpoint, connect=(), open_timeout_s=0.0)
    with pytest.raises(TransportError, match=r"nobody answers at .*: is irsd running\?"):
        open_session(quick, "client")


def test_two_hubs_on_one_endpoint_say_so(settings: ZenohSettings, opened: Callable[[Role], Session]) -> None:
    opened("hub")
    with pytest.raises(TransportError, match="another irsd has it"):
        open_session(ZenohSettings(endpoint=settings.endpoint, connect=(), open_timeout_s=0.0), "hub")


def test_an_endpoint_that_is_none_is_refused() -> None:
    with pytest.raises(TransportError, match="such as tcp"):
        open_session(ZenohSettings(endpoint="7448", connect=(), open_timeout_s=0.0), "hub")


def test_every_peer_listens_and_history_is_possible() -> None:
    for role in ("hub", "peer"):
        config = session_config(ZenohSettings(), role)
        assert "tcp/127.0.0.1:0" in config["listen"]["endpoints"]
        assert config["timestamping"]["enabled"]["peer"]
        assert config["scouting"]["multicast"]["enabled"] is False
    assert session_config(ZenohSettings(), "hub")["connect"]["endpoints"] == ["tcp/127.0.0.1:7447"]
    assert session_config(ZenohSettings(router=True), "hub")["mode"] == "router"
    assert session_config(ZenohSettings(router=True), "peer")["mode"] == "peer"


def test_the_environment_moves_the_meeting_point(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("IRSD_ENDPOINT", "IRSD_CONNECT"):
        monkeypatch.delenv(name, raising=False)
    assert with_environment(ZenohSettings()) == ZenohSettings()
    monkeypatch.setenv("IRSD_ENDPOINT", "tcp/127.0.0.1:9")
    monkeypatch.setenv("IRSD_CONNECT", "")
    assert with_environment(ZenohSettings()) == ZenohSettings(endpoint="tcp/127.0.0.1:9", connect=())
    assert with_environment(ZenohSettings(), "tcp/10.0.0.1:1").endpoint == "tcp/10.0.0.1:1"
    monkeypatch.setenv("IRSD_CONNECT", "tcp/a:1, tcp/b:2")
    assert with_environment(ZenohSettings()).connect == ("tcp/a:1", "tcp/b:2")


# -------------------------------------------------------------------------------------------------------------- traps
def test_an_unread_subscriber_stalls_nothing(opened: Callable[[Role], Session]) -> None:
    """With zenoh's FIFO handler unread, another key of the session gets nothing and its queryable does not answer."""
    daemon, robot = opened("hub"), opened("peer")
    unread: Ring[Sample] = Ring(8)
    poses: Ring[Sample] = Ring(200)
    daemon.subscribe("test/lidar", unread)
    daemon.subscribe("test/odom", poses)
    daemon.queryable("test/q", lambda query: query.reply("test/q", b"here"))
    assert linked(daemon, robot)
    assert until(lambda: bool(robot.get("test/q")))
    for number in range(1000):
        robot.put("test/lidar", b"x" * 2000)
        if number % 10 == 0:
            robot.put("test/odom", b"%d" % number)
    assert until(lambda: poses.received == 100)
    assert poses.dropped == 0
    assert [r.payload for r in robot.get("test/q")] == [b"here"]
    assert until(lambda: unread.received == 1000)
    assert (len(unread), unread.dropped) == (8, 992)


def test_a_slow_callback_and_a_slow_answer_stall_nothing(opened: Callable[[Role], Session]) -> None:
    daemon, robot = opened("hub"), opened("peer")
    gate, poses = Event(), Ring[Sample](2000)

    def wait_for_gate(_: object) -> None:
        gate.wait(WAIT_S)

    daemon.subscribe("test/slow", wait_for_gate)
    daemon.subscribe("test/odom", poses)
    daemon.queryable("test/slow_answer", wait_for_gate)
    daemon.queryable("test/q", lambda query: query.reply("test/q", b"here"))
    assert linked(daemon, robot)
    assert until(lambda: bool(robot.get("test/q")))
    assert [r.ok for r in robot.get("test/slow_answer", timeout_s=0.05)] in ([], [False])
    for _ in range(1000):
        robot.put("test/slow", b"x" * 1000)
        robot.put("test/odom", b"pose")
    assert until(lambda: poses.received == 1000)
    assert [r.payload for r in robot.get("test/q")] == [b"here"]
    assert until(lambda: daemon.counters()["callback_drops"] >= 1000 - 256 - 1)
    gate.set()


def use_in_child(session: Session, results: multiprocessing.SimpleQueue[str]) -> None:
    try:
        session.put("test/a", b"")
        results.put("no error")
    except TransportError as error:
        results.put(str(error))
    session.close()  # must neither hang nor close the parent's session


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_gets_an_error_instead_of_hanging(opened: Callable[[Role], Session]) -> None:
    hub, peer = opened("hub"), opened("peer")
    got: Ring[Sample] = Ring(64)
    hub.subscribe("test/a", got)
    assert linked(hub, peer)
    context = multiprocessing.get_context("fork")
    results = context.SimpleQueue()
    child = context.Process(target=use_in_child, args=(peer, results))
    child.start()
    child.join(WAIT_S)
    assert child.exitcode == 0
    assert "spawn" in results.get()
    assert until(lambda: (peer.put("test/a", b"parent"), bool(len(got)))[1])


def test_a_process_that_forgets_to_close_still_ends(settings: ZenohSettings) -> None:
    program = f"""
from irsd.io.session import ZenohSettings, open_session
session = open_session(ZenohSettings(endpoint={settings.endpoint!r}, connect=()), "hub")
session.subscribe("a", lambda sample: None)
session.queryable("b", lambda query: None)
raise SystemExit(3)
"""
    done = subprocess.run([sys.executable, "-c", program], timeout=60, check=False, env=dict(os.environ))
    assert done.returncode == 3


def test_errors_of_callbacks_are_counted_and_of_handlers_answered(
    opened: Callable[[Role], Session], caplog: pytest.LogCaptureFixture
) -> None:
    hub, peer = opened("hub"), opened("peer")
    got: Ring[Sample] = Ring(4)

    def fail_once(sample: Sample) -> None:
        if sample.payload == b"bad":
            raise ValueError("what is this")
        got.put(sample)

    def refuse(query: Query) -> None:
        raise TransportError("no such thing") if query.payload == b"ours" else ZeroDivisionError("x")

    hub.subscribe("test/a", fail_once)
    hub.queryable("test/q", refuse)
    assert linked(hub, peer)
    assert until(lambda: bool(peer.get("test/q", payload=b"ours")))
    peer.put("test/a", b"bad")
    peer.put("test/a", b"good")
    sample = got.get(WAIT_S)
    assert sample is not None
    assert sample.payload == b"good"
    assert hub.counters()["callback_errors"] == 1
    (ours,) = peer.get("test/q", payload=b"ours")
    assert (ours.ok, ours.error) == (False, "no such thing")
    (other,) = peer.get("test/q", payload=b"other")
    assert "internal error" in other.error
    assert hub.counters()["query_errors"] >= 3
    assert "what is this" in caplog.text


# ----------------------------------------------------------------------------------------------------------- messages
def test_a_message_arrives_whole(opened: Callable[[Role], Session]) -> None:
    hub, peer = opened("hub"), opened("peer")
    got: Ring[Sample] = Ring(8)
    hub.subscribe("test/**", got)
    assert linked(hub, peer)
    publisher = peer.publisher("test/pub", encoding=CDR, priority="real_time", express=True, block=False)
    assert until(lambda: (publisher.put(b"\x00\x01", attachment=b"meta"), bool(len(got)))[1])
    first = got.get(0)
    assert first is not None
    assert (first.key, first.payload, first.encoding) == ("test/pub", b"\x00\x01", CDR)
    assert (first.attachment, first.deleted) == (b"meta", False)
    got.drain()
    publisher.close()
    publisher.close()
    peer.delete("test/gone")
    gone = got.get(WAIT_S)
    while gone is not None and not gone.deleted:
        gone = got.get(WAIT_S)
    assert gone is not None
    assert (gone.key, gone.payload) == ("test/gone", b"")


def test_questions_carry_parameters_and_payload(opened: Callable[[Role], Session]) -> None:
    hub, peer = opened("hub"), opened("peer")

    def answer(query: Query) -> None:
        for name in ("I1", "I2", "R1"):
            if query.matches(f"test/{name}"):
                query.reply(f"test/{name}", query.payload + query.parameters.get("a", "").encode(), attachment=b"h")

    hub.queryable("test/*", answer)
    assert linked(hub, peer)
    assert until(lambda: bool(peer.get("test/I1")))
    replies = peer.get("test/*?a=1;b=2", payload=b"p")
    assert sorted(reply.key for reply in replies) == ["test/I1", "test/I2", "test/R1"]
    assert {(reply.payload, reply.attachment, reply.ok) for reply in replies} == {(b"p1", b"h", True)}
    assert [reply.key for reply in peer.get("test/I2")] == ["test/I2"]
    assert peer.get("nobody/answers/this") == []


def test_history_reaches_those_who_come_late(opened: Callable[[Role], Session]) -> None:
    hub = opened("hub")
    publisher = hub.history_publisher("test/delta", keep=3)
    for number in range(5):
        publisher.put(b"%d" % number)
    late = opened("peer")
    got: Ring[Sample] = Ring(16)
    late.subscribe_history("test/delta", got)
    assert until(lambda: got.received == 3)
    publisher.put(b"5")
    assert until(lambda: got.received == 4)
    assert [sample.payload for sample in got.drain()] == [b"2", b"3", b"4", b"5"]


def test_life_and_death_are_seen(settings: ZenohSettings, opened: Callable[[Role], Session]) -> None:
    hub = opened("hub")
    seen: Ring[Sample] = Ring(8)
    hub.watch_alive("test/alive/*", seen)
    assert hub.find_alive("test/alive/*") == []
    with open_session(settings, "peer") as peer:
        peer.announce("test/alive/r1")
        born = seen.get(WAIT_S)
        assert born is not None
        assert (born.key, born.deleted) == ("test/alive/r1", False)
        assert hub.find_alive("test/alive/*") == ["test/alive/r1"]
    died = seen.get(WAIT_S)
    assert died is not None
    assert died.deleted


def test_a_closed_session_and_a_bad_key_raise(settings: ZenohSettings) -> None:
    session = open_session(settings, "hub")
    with pytest.raises(TransportError, match="Invalid Key"):
        session.put("a//b#", b"")
    with pytest.raises(TransportError):
        session.subscribe("a//b", Ring[Sample](1))
    session.close()
    session.close()
    with pytest.raises(TransportError, match="closed"):
        session.put("a", b"")
