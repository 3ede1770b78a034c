"""``irs/<robot>/map/odom``: where the odometry's frame lies in irsd's map, told at every sweep and answered to late questions.

Whoever has a pose in the odometry's frame and a goal in the map needs it, as a ROS node needs TF's map -> odom; ``MapFrame``
follows it.
"""

from __future__ import annotations

import json
import math
from typing import Any

from irsd.core.errors import DecodeError, TransportError
from irsd.core.geometry import Pose, pose_from_xy_yaw, quat_xyzw_to_matrix, yaw_of
from irsd.core.runtime import Cell
from irsd.core.types import Localisation, OdomSample
from irsd.io import cdr
from irsd.io.keys import RobotKeys, bridge_key, rmw_key, ros_attachment, ros_endpoint_token, ros_gid, ros_node_token
from irsd.io.session import CDR, Handle, Query, Sample, Session

SCHEMA = "irs/localisation/1"
STATES = ("map", "odometry", "off")
_TF_TOPIC = "/tf"


def localisation_to_json(where: Localisation, *, seq: int, frame: str) -> bytes:
    """The document; frame: the map's name."""
    document = {
        "schema": SCHEMA,
        "seq": seq,
        "frame": frame,
        "odom_frame": where.odom_frame,
        "stamp_ns": where.stamp_ns,
        "state": where.state,
        "map_T_odom": _xyz_yaw(where.map_T_odom),
        "map_T_base": _xyz_yaw(where.map_T_base),
    }
    return json.dumps(document).encode()


def localisation_from_json(payload: bytes) -> Localisation:
    """Inverse of ``localisation_to_json`` for a robot that stands upright. Raises DecodeError."""
    try:
        document: dict[str, Any] = json.loads(payload)
        if document["schema"] != SCHEMA or document["state"] not in STATES:
            raise ValueError(f"schema {document['schema']!r}, state {document['state']!r}")
        places = [[float(document[name][k]) for k in ("x", "y", "yaw", "z")] for name in ("map_T_odom", "map_T_base")]
        if not all(math.isfinite(value) for place in places for value in place):
            raise ValueError("a place is not finite")
        map_T_odom, map_T_base = (pose_from_xy_yaw(*place) for place in places)
        return Localisation(
            int(document["stamp_ns"]), str(document["odom_frame"]), map_T_odom, map_T_base, document["state"]
        )
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise DecodeError(f"no {SCHEMA} document: {error!r}") from error


def _xyz_yaw(pose: Pose) -> dict[str, float]:
    x, y, z = (round(float(v), 5) for v in pose[:3, 3])
    return {"x": x, "y": y, "z": z, "yaw": round(yaw_of(pose), 6)}


class TfPublisher:
    """The same as map -> odom on /tf, for ROS behind either bridge. ``publish``: from one thread."""

    def __init__(self, session: Session, *, namespace: str = "", domain: int | None = None) -> None:
        self._session = session
        known, number = cdr.type_hash(cdr.TF_MESSAGE), domain or 0
        token = ros_endpoint_token(
            session.zid, "irsd", 0, _TF_TOPIC, cdr.TF_MESSAGE, known, publishes=True, domain=number
        )
        self._tokens: list[Handle] = [
            session.announce(ros_node_token(session.zid, "irsd", number)),
            session.announce(token),
        ]
        self._gid = ros_gid(token)
        self._bridge = bridge_key(_TF_TOPIC, namespace)
        self._rmw = rmw_key(_TF_TOPIC, cdr.TF_MESSAGE, known, number)
        self._seq = 0

    def publish(self, where: Localisation, frame: str) -> None:
        """frame: the map's name. Under the keys of both bridges: only one of them listens."""
        self._seq += 1
        transform = cdr.make_transform(where.stamp_ns, frame, where.odom_frame, where.map_T_odom)
        payload = cdr.write(cdr.make(cdr.TF_MESSAGE, transforms=[transform]))
        self._session.put(self._bridge, payload, encoding=CDR, express=True, block=False)
        attachment = ros_attachment(self._seq, where.stamp_ns, self._gid)
        self._session.put(self._rmw, payload, encoding=CDR, attachment=attachment, express=True, block=False)

    def close(self) -> None:
        for token in self._tokens:
            token.close()


class LocalisationPublisher:
    """Tells the network of every localisation. ``publish``: from one thread."""

    def __init__(self, session: Session, keys: RobotKeys, frame: str, tf: TfPublisher | None = None) -> None:
        """frame: the map's name. tf: told too."""
        self._key, self._frame, self._tf = keys.map_odom, frame, tf
        self._seq = 0
        self._last = Cell(b"")
        self._publisher = session.publisher(self._key, express=True, block=False)
        self._answering = session.queryable(self._key, self._answer)

    def publish(self, where: Localisation) -> None:
        """Does not wait for the network: the next one comes with the next sweep."""
        self._seq += 1
        self._last.set(localisation_to_json(where, seq=self._seq, frame=self._frame))
        self._publisher.put(self._last.get())
        if self._tf is not None:
            self._tf.publish(where, self._frame)

    def close(self) -> None:
        self._answering.close()
        self._publisher.close()
        if self._tf is not None:
            self._tf.close()

    def _answer(self, query: Query) -> None:
        document = self._last.get()
        if not document:
            raise TransportError("no sweep has been placed in the map yet")
        query.reply(self._key, document)


class MapFrame:
    """Follows where the odometry's frame lies in the map. ``to_map`` may be called from any thread.

    Until irsd has said anything the two are taken for the same, which they are when irsd starts.
    """

    def __init__(self, session: Session, keys: RobotKeys, timeout_s: float = 1.0) -> None:
        """timeout_s: for the question where it lies now."""
        self._where: Cell[Localisation | None] = Cell(None)
        self._bad: Cell[int] = Cell(0)
        self._subscription = session.subscribe(keys.map_odom, self._hear)
        for reply in session.get(keys.map_odom, timeout_s=timeout_s):
            if reply.ok and self._where.get() is None:
                self._take(reply.payload)

    @property
    def where(self) -> Localisation | None:
        """The last word; None before the first."""
        return self._where.get()

    @property
    def bad_documents(self) -> int:
        """What came under the key and was something else."""
        return self._bad.get()

    @property
    def xy_yaw(self) -> tuple[float, float, float]:
        """map_T_odom as (x_m, y_m, yaw_rad)."""
        where = self._where.get()
        if where is None:
            return 0.0, 0.0, 0.0
        pose = where.map_T_odom
        return float(pose[0, 3]), float(pose[1, 3]), yaw_of(pose)

    def to_map(self, xy_yaw: tuple[float, float, float]) -> tuple[float, float, float]:
        """A pose (x_m, y_m, yaw_rad) of the odometry's frame in the map; yaw in -pi..pi."""
        x, y, yaw = self.xy_yaw
        c, s, turned = math.cos(yaw), math.sin(yaw), yaw + xy_yaw[2]
        place = x + c * xy_yaw[0] - s * xy_yaw[1], y + s * xy_yaw[0] + c * xy_yaw[1]
        return *place, math.atan2(math.sin(turned), math.cos(turned))

    def robot(self, odometry: OdomSample) -> tuple[float, float, float]:
        """Where the odometry's robot is in the map: (x_m, y_m, yaw_rad)."""
        x, y, _ = (float(v) for v in odometry.position_m)
        return self.to_map((x, y, yaw_of(quat_xyzw_to_matrix(odometry.quat_xyzw))))

    def close(self) -> None:
        self._subscription.close()

    def _hear(self, sample: Sample) -> None:
        if not sample.deleted:
            self._take(sample.payload)

    def _take(self, payload: bytes) -> None:
        try:
            self._where.set(localisation_from_json(payload))
        except DecodeError:
            self._bad.set(self._bad.get() + 1)
