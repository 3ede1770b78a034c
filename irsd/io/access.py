"""Who may speak on zenoh and who may do what: TLS with certificates on both sides, and rights by the certificate's name.

Three roles, by the common name of a certificate: *services* (irsd, nav_bridge, the bridge that carries the sensors) may do everything;
*operators* may read the graph and the status, send goals and commands; *viewers* may read. Whoever else has a certificate of the
same authority may connect and do nothing; whoever has none can't connect. Every process enforces the rights on its own links.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from irsd.core.errors import ConfigError
from irsd.core.settings import setting

_READ = (
    "irs/*/alive",
    "irs/*/status",
    "irs/*/graph/**",
    "irs/*/graph/delta/@adv/**",  # history of deltas; ** does not reach into @ parts
    "irs/*/map/**",
    "irs/*/nav/alive",
    "irs/*/nav/state",
    "irs/*/nav/faults",
    "irs/*/nav/waypoints",
    "irs/*/nav/path",
    "irs/*/nav/goal_pose",
)
_ASK = ("irs/*/nav/goto", "irs/*/nav/cancel", "irs/*/nav/why", "irs/*/cmd/**")
_TO_READ = ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query")
_TO_BE_TOLD = ("put", "delete", "reply", "liveliness_token", "declare_queryable")
_ALL = tuple(dict.fromkeys(_TO_READ + _TO_BE_TOLD))


@dataclass(frozen=True)
class TlsSettings:
    """Certificates, PEM files. With a key set, every endpoint must be tls/, and both sides show a certificate of the authority."""

    ca: str = setting("", "certificate of the authority that signs all others")
    certificate: str = setting("", "this process's certificate; its common name is who it is")
    key: str = setting("", "this process's private key; empty: no TLS")


@dataclass(frozen=True)
class AccessSettings:
    """Who may do what, by the common names of certificates. Needs zenoh.tls; all three empty: whoever connects may do everything."""

    services: tuple[str, ...] = setting((), "may do everything: irsd, nav_bridge, the bridge that carries the sensors")
    operators: tuple[str, ...] = setting((), "may read everything, send goals and commands")
    viewers: tuple[str, ...] = setting((), "may read graph, map, status and the state of drives")

    @property
    def enabled(self) -> bool:
        return bool(self.services or self.operators or self.viewers)


def check_security(tls: TlsSettings, access: AccessSettings, endpoints: tuple[str, ...]) -> None:
    """ConfigError for settings that would leave a door open that they seem to shut."""
    if access.enabled and not tls.key:
        raise ConfigError("zenoh.access: names are those of certificates: set zenoh.tls.ca, certificate and key")
    if not tls.key:
        if any(endpoint.startswith("tls/") for endpoint in endpoints):
            raise ConfigError("zenoh: an endpoint is tls/..., so zenoh.tls.ca, certificate and key must be set")
        return
    if not (tls.ca and tls.certificate):
        raise ConfigError("zenoh.tls: ca, certificate and key belong together")
    bare = [endpoint for endpoint in endpoints if not endpoint.startswith("tls/")]
    if bare:
        raise ConfigError(
            f"zenoh: {', '.join(bare)} is open to whoever has no certificate; with zenoh.tls every endpoint must be tls/..."
        )
    twice = sorted(
        name
        for name in {*access.services, *access.operators, *access.viewers}
        if (name in access.services) + (name in access.operators) + (name in access.viewers) > 1
    )
    if twice:
        raise ConfigError(f"zenoh.access: {', '.join(twice)} is in more than one list")


def security_config(tls: TlsSettings, access: AccessSettings) -> dict[str, Any]:
    """The parts of zenoh's configuration: ``tls`` (of transport.link) and ``access_control``; empty where nothing is set."""
    out: dict[str, Any] = {}
    if tls.key:
        out["tls"] = {
            "root_ca_certificate": tls.ca,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "listen_private_key": tls.key,
            "listen_certificate": tls.certificate,
            "connect_private_key": tls.key,
            "connect_certificate": tls.certificate,
        }
    if access.enabled:
        out["access_control"] = _access_control(access)
    return out


def _access_control(access: AccessSettings) -> dict[str, Any]:
    """Nothing is allowed but what a role allows. From a reader comes only asking; to it goes only what it may know.

    A rule holds for one link: *ingress* is what comes from the one with the certificate, *egress* what goes to it.
    """
    rules = [
        _rule("everything", ["**", "**/@adv/**", "@/**", "@ros2_lv/**"], ["ingress", "egress"], _ALL),
        _rule("read-ask", list(_READ), ["ingress"], _TO_READ),
        _rule("read-told", list(_READ), ["egress"], _TO_BE_TOLD),
        _rule("operate-ask", list(_ASK), ["ingress"], ("query",)),
        _rule("operate-told", list(_ASK), ["egress"], ("reply", "declare_queryable")),
    ]
    reading, operating = ["read-ask", "read-told"], ["operate-ask", "operate-told"]
    roles = (
        ("services", access.services, ["everything"]),
        ("operators", access.operators, reading + operating),
        ("viewers", access.viewers, reading),
    )
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": list(names)} for name, names, _ in roles if names],
        "policies": [{"rules": allowed, "subjects": [name]} for name, names, allowed in roles if names],
    }


def _rule(name: str, keys: list[str], flows: list[str], messages: tuple[str, ...]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": list(messages), "key_exprs": keys}
