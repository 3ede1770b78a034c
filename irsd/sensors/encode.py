"""Values to the bytes that a robot's drivers would send: the inverse of ``decode``, for the embedded world and for tests."""

from __future__ import annotations

import json
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import CameraImage, CameraModel, Detections, LidarScan, OdomSample, StaticTransform
from irsd.io import cdr as ros

_FLOAT32 = 7  # sensor_msgs/msg/PointField
_FIELDS = ("x", "y", "z", "intensity", "time")


def encode_pointcloud2(scan: LidarScan, intensity: NDArray[np.float32] | None = None) -> bytes:
    """PointCloud2 with float32 x, y, z, intensity and, where the scan has it, ``time`` in seconds after the stamp.

    intensity: float32 [N], zeros when not given.
    """
    names = _FIELDS if scan.time_offset_s is not None else _FIELDS[:4]
    points = np.zeros((len(scan.points_sensor), len(names)), "<f4")
    points[:, :3] = scan.points_sensor
    if intensity is not None:
        points[:, 3] = intensity
    if scan.time_offset_s is not None:
        points[:, 4] = scan.time_offset_s
    step = 4 * len(names)
    fields = [
        ros.make(ros.POINT_FIELD, name=name, offset=4 * k, datatype=_FLOAT32, count=1) for k, name in enumerate(names)
    ]
    message = ros.make(
        ros.POINT_CLOUD,
        header=ros.make_header(scan.stamp_ns, scan.frame_id),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * len(points),
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )
    return ros.write(message)


def encode_image(image: CameraImage) -> bytes:
    """Image in bgr8 without padding."""
    height, width = image.bgr.shape[:2]
    message = ros.make(
        ros.IMAGE,
        header=ros.make_header(image.stamp_ns, image.frame_id),
        height=height,
        width=width,
        encoding="bgr8",
        is_bigendian=0,
        step=3 * width,
        data=np.ascontiguousarray(image.bgr).reshape(-1),
    )
    return ros.write(message)


def encode_compressed_image(image: CameraImage, file_format: str = "jpeg", quality: int = 88) -> bytes:
    """CompressedImage. file_format: ``jpeg`` (with quality 0..100) or ``png`` (lossless)."""
    if file_format == "jpeg":
        file = _file_of(image.bgr, ".jpg", (cv2.IMWRITE_JPEG_QUALITY, quality))
    elif file_format == "png":
        file = _file_of(image.bgr, ".png", (cv2.IMWRITE_PNG_COMPRESSION, 3))
    else:
        raise ValueError(f"format {file_format!r} is neither jpeg nor png")
    return _compressed(image.stamp_ns, image.frame_id, file_format, file)


def encode_camera_info(camera: CameraModel, stamp_ns: int) -> bytes:
    """CameraInfo of the whole picture: no binning, no region of interest, no rectification."""
    k = np.asarray(camera.matrix, np.float64)
    message = ros.make(
        ros.CAMERA_INFO,
        header=ros.make_header(stamp_ns, camera.frame_id),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model=camera.model,
        d=np.asarray(camera.distortion, np.float64),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([k, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=ros.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )
    return ros.write(message)


def encode_odometry(
    sample: OdomSample,
    linear_m_s: Sequence[float] = (0.0, 0.0, 0.0),
    angular_rad_s: Sequence[float] = (0.0, 0.0, 0.0),
) -> bytes:
    """Odometry with zero covariance (unknown). The velocities are those of ``child_frame_id``, in itself."""
    pose = ros.make_pose_message(sample.position_m, sample.quat_xyzw)
    linear, angular = (
        ros.make("geometry_msgs/msg/Vector3", x=float(v[0]), y=float(v[1]), z=float(v[2]))
        for v in (linear_m_s, angular_rad_s)
    )
    twist = ros.make("geometry_msgs/msg/Twist", linear=linear, angular=angular)
    unknown = np.zeros(36)
    message = ros.make(
        ros.ODOMETRY,
        header=ros.make_header(sample.stamp_ns, sample.frame_id),
        child_frame_id=sample.child_frame_id,
        pose=ros.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
        twist=ros.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )
    return ros.write(message)


def encode_tf(transforms: Sequence[StaticTransform], stamp_ns: int = 0) -> bytes:
    """TFMessage of fixed mountings."""
    made = [ros.make_transform(stamp_ns, t.parent, t.child, t.parent_T_child) for t in transforms]
    return ros.write(ros.make(ros.TF_MESSAGE, transforms=made))


def encode_detections(detections: Detections) -> tuple[bytes, bytes]:
    """(detections/ids as CompressedImage CDR with a 16-bit PNG, detections/info as JSON)."""
    ids = np.ascontiguousarray(detections.ids_px, np.uint16)
    file = _file_of(ids, ".png", (cv2.IMWRITE_PNG_COMPRESSION, 3))
    entries = []
    for row, number in enumerate(detections.number.tolist()):
        entry = {
            "id": number,
            "label": detections.label[row],
            "score": _short(detections.score[row]),
            "labels": [[name, _short(score)] for name, score in detections.top_labels[row]],
        }
        if detections.embedding is not None:
            entry["embedding"] = [_short(v) for v in detections.embedding[row]]
        entries.append(entry)
    info = {"stamp_ns": detections.stamp_ns, "frame_id": detections.frame_id, "detections": entries}
    return _compressed(detections.stamp_ns, detections.frame_id, "png", file), json.dumps(info).encode()


def _short(value: float | np.floating) -> float:
    """The number with the digits that float32 has."""
    return float(f"{float(value):.8g}")


def _file_of(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], suffix: str, options: tuple[int, int]
) -> NDArray[np.uint8]:
    ok, file = cv2.imencode(suffix, pixels, list(options))
    if not ok:
        raise ValueError(f"pixels {pixels.dtype} {pixels.shape} can't be written as {suffix}")
    return np.asarray(file, np.uint8).reshape(-1)


def _compressed(stamp_ns: int, frame_id: str, file_format: str, file: NDArray[np.uint8]) -> bytes:
    header = ros.make_header(stamp_ns, frame_id)
    return ros.write(ros.make(ros.COMPRESSED_IMAGE, header=header, format=file_format, data=file))
