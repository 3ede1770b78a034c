"""Who may do what: real TLS, real certificates, the shipped examples; every action that is denied is denied, every other works."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from navigation_standin import free_endpoint

from irsd.config import load_config
from irsd.core.errors import ConfigError, TransportError
from irsd.core.runtime import Ring, monotonic_s, sleep_s
from irsd.io.access import AccessSettings, TlsSettings
from irsd.io.endpoints import session_config, with_environment
from irsd.io.session import Sample, Session, ZenohSettings, open_session
from nav_bridge.config import load_settings

SECURE = Path(__file__).resolve().parents[2] / "config" / "secure"
WAIT_S = 20.0
QUIET_S = 0.7  # how long a message that must not come is waited for, after one that must come has come

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What make-certificates.sh makes, and one more certificate of the same authority with a name that has no role."""
    folder = tmp_path_factory.mktemp("tls")
    script = (SECURE / "make-certificates.sh").read_text().replace("operator viewer;", "operator viewer stranger;")
    subprocess.run(["sh", "-c", script, "make", str(folder)], check=True, capture_output=True)
    subprocess.run(["sh", SECURE / "make-certificates.sh", folder / "other"], check=True, capture_output=True)
    return folder


def identity(folder: Path, name: str) -> TlsSettings:
    return TlsSettings(str(folder / "ca.pem"), str(folder / f"{name}.pem"), str(folder / f"{name}.key"))


class Network:
    """irsd and nav_bridge as the examples make them, with something to read and to ask for; others come by ``person``."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder, self.stack = folder, stack
        self.endpoint = free_endpoint().replace("tcp/", "tls/")
        self.asked: list[str] = []
        self.hub = self._open(load_config(SECURE / "irsd.yaml").zenoh, "irsd", "hub")
        self.nav = self._open(load_settings(SECURE / "nav_bridge.yaml").zenoh, "nav-bridge", "peer")
        for key in ("graph/snapshot", "status", "cmd/teach", "map/occupancy"):
            self._answer(self.hub, f"irs/r/{key}")
        for key in ("nav/goto", "nav/cancel", "nav/why"):
            self._answer(self.nav, f"irs/r/{key}")
        self.deltas = self.hub.history_publisher("irs/r/graph/delta")
        self.deltas.put(b"delta 1")
        self.hub.announce("irs/r/alive")

    def _open(self, settings: ZenohSettings, name: str, role: str) -> Session:
        settings = dataclasses.replace(settings, endpoint=self.endpoint, tls=identity(self.folder, name))
        return self.stack.enter_context(open_session(settings, role))  # type: ignore[arg-type]

    def _answer(self, session: Session, key: str) -> None:
        def reply(query: object) -> None:
            self.asked.append(key)
            query.reply(key, b"yes")  # type: ignore[attr-defined]

        session.queryable(key, reply)

    def person(self, name: str) -> Session:
        listen = ("tls/127.0.0.1:0",)
        settings = ZenohSettings(self.endpoint, listen, (), open_timeout_s=WAIT_S, tls=identity(self.folder, name))
        return self.stack.enter_context(open_session(settings, "client"))

    def may_ask(self, session: Session, key: str, expected: bool) -> bool:
        """Whether a question reaches the one who answers; asked again for a while where it should."""
        end_s = monotonic_s() + (WAIT_S if expected else 0.0)
        while True:
            self.asked.clear()
            replies = [r for r in session.get(key, timeout_s=2.0) if r.ok and r.payload == b"yes"]
            if replies or monotonic_s() >= end_s:
                assert bool(replies) == bool(self.asked), "asked without an answer, or answered without being asked"
                return bool(replies)


@pytest.fixture(scope="module")
def network(certificates: Path) -> Iterator[Network]:
    with ExitStack() as stack:
        yield Network(certificates, stack)


READ = ("irs/r/graph/snapshot", "irs/r/status", "irs/r/map/occupancy")
STEER = ("irs/r/nav/goto", "irs/r/nav/cancel", "irs/r/cmd/teach", "irs/r/nav/why")


@pytest.mark.parametrize(
    ("name", "reads", "steers"), [("operator", True, True), ("viewer", True, False), ("stranger", False, False)]
)
def test_what_each_role_may(network: Network, name: str, reads: bool, steers: bool) -> None:
    person = network.person(name)
    for key in READ:
        assert network.may_ask(person, key, reads) == reads, key
    for key in STEER:
        assert network.may_ask(person, key, steers) == steers, key
    assert person.find_alive("irs/*/alive", timeout_s=2.0) == (["irs/r/alive"] if reads else [])
    told: Ring[Sample] = Ring(64)
    person.subscribe_history("irs/r/graph/delta", told)
    end_s = monotonic_s() + (WAIT_S if reads else QUIET_S)
    while not told.received and monotonic_s() < end_s:
        network.deltas.put(b"more")
        sleep_s(0.1)
    assert bool(told.received) == reads


@pytest.mark.parametrize("name", ["operator", "viewer", "stranger"])
def test_nobody_but_a_service_writes(network: Network, name: str) -> None:
    """No false sensors, no false graph, no false waypoints, no raw sensor data for outsiders."""
    person, sensors, listener = network.person(name), network.person("sensors"), network.person(name)
    hub: Ring[Sample] = Ring(64)
    outside: Ring[Sample] = Ring(64)
    for key in ("lidar/points", "irs/r/graph/rooms/R1", "irs/r/nav/waypoints", "irs/r/nav/state"):
        network.hub.subscribe(key, hub)
    listener.subscribe("lidar/points", outside)
    listener.subscribe("**", outside)
    end_s = monotonic_s() + WAIT_S
    while not hub.received and monotonic_s() < end_s:  # the service's message comes through, so links are up
        for key in ("lidar/points", "irs/r/graph/rooms/R1", "irs/r/nav/waypoints", "irs/r/nav/state"):
            person.put(key, b"forged")
            person.delete(key)
        sensors.put("lidar/points", b"true")
        sleep_s(0.1)
    sleep_s(QUIET_S)
    heard = hub.drain()
    assert heard
    assert {sample.payload for sample in heard} == {b"true"}
    assert [sample.key for sample in outside.drain()] == []


def test_without_a_certificate_of_the_authority_nobody_connects(network: Network, certificates: Path) -> None:
    other = dataclasses.replace(identity(certificates / "other", "operator"), ca=str(certificates / "ca.pem"))
    for tls in (other, TlsSettings()):
        endpoint = network.endpoint if tls.key else network.endpoint.replace("tls/", "tcp/")
        settings = ZenohSettings(endpoint, ("tls/127.0.0.1:0",) if tls.key else (), (), open_timeout_s=0.5, tls=tls)
        with pytest.raises(TransportError):
            open_session(settings, "client")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (ZenohSettings(access=AccessSettings(viewers=("v",))), "names are those of certificates"),
        (ZenohSettings(tls=TlsSettings("ca", "cert", "key")), "open to whoever has no certificate"),
        (ZenohSettings(endpoint="tls/127.0.0.1:1"), "must be set"),
        (ZenohSettings("tls/h:1", (), (), tls=TlsSettings("", "cert", "key")), "belong together"),
        (
            ZenohSettings(
                "tls/h:1", (), (), tls=TlsSettings("a", "b", "c"), access=AccessSettings(("x",), ("x",), ("y",))
            ),
            "x is in more than one list",
        ),
    ],
)
def test_a_door_left_open_is_refused(settings: ZenohSettings, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        session_config(settings, "hub")


def test_irsctl_says_who_asks_by_the_environment(certificates: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("IRSD_CONNECT", raising=False)
    monkeypatch.setenv("IRSD_TLS", "/home/me/irsd")
    settings = with_environment(ZenohSettings(), "tls/10.0.0.5:7448")
    assert settings.tls == TlsSettings("/home/me/irsd/ca.pem", "/home/me/irsd/cert.pem", "/home/me/irsd/key.pem")
    session_config(settings, "client")
