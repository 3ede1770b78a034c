"""Sensor bytes to values: the only parser of sensor messages. Wrong bytes raise DecodeError; nothing else ever comes out.

Every size a message claims is held against the bytes that are there before anything is allocated. Frame names lose a leading slash.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.geometry import make_pose
from irsd.core.types import CameraImage, CameraModel, Detections, LidarScan, OdomSample, Sensed, StaticTransform
from irsd.io import cdr as ros
from irsd.perception.detections import IdsImage, build, parse_info
from irsd.sensors import pictures
from irsd.sensors.point_time import TIME_FIELDS, offsets_s

Bytes = bytes | memoryview

# sensor_msgs/msg/PointField: datatype -> numpy kind and size
_POINT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}

# CameraInfo.distortion_model -> our name and the numbers of coefficients it may have
_DISTORTION = {
    "": ("plumb_bob", (0, 4, 5, 8)),
    "none": ("plumb_bob", (0, 4, 5)),
    "plumb_bob": ("plumb_bob", (0, 4, 5)),
    "rational_polynomial": ("rational_polynomial", (0, 8, 12, 14)),
    "equidistant": ("equidistant", (0, 4)),
    "fisheye": ("equidistant", (0, 4)),
}


# ------------------------------------------------------------------------------------------------------- lidar
@np.errstate(invalid="ignore", over="ignore")  # bytes may spell signalling NaNs; they are dropped, not warned about
def decode_pointcloud2(cdr: Bytes) -> LidarScan:
    """sensor_msgs/msg/PointCloud2 with x, y, z of any number type, in any order, with any padding and byte order.

    Points that are not finite, and points at the sensor itself (how drivers write "no return"), are left out, whatever
    ``is_dense`` claims. Time per point: see ``point_time``. Raises DecodeError.
    """
    message = ros.read(cdr, ros.POINT_CLOUD)
    stamp_ns = ros.stamp_of(message.header)
    layout = _point_layout(message)
    xyz = _xyz(layout)
    name = next((n for n in TIME_FIELDS if n in layout.fields), None)
    offset_s = None if name is None else offsets_s(layout.column(name), stamp_ns, name)
    keep = np.isfinite(xyz).all(1) & xyz.any(1)
    if offset_s is not None:
        keep &= np.isfinite(offset_s)
    if not keep.all():
        xyz = xyz[keep]
        offset_s = None if offset_s is None else offset_s[keep]
    return LidarScan(stamp_ns, ros.frame_of(message.header.frame_id), xyz, offset_s)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where the numbers of a cloud lie in its bytes. fields: name -> (numpy type, offset in the point)."""

    data: NDArray[np.uint8]
    height: int
    width: int
    row_step: int
    point_step: int
    fields: Mapping[str, tuple[str, int]]

    def column(self, name: str) -> NDArray[Any]:
        """One field of all points [N], in the type it was sent in; may view the message."""
        dtype, offset = self.fields[name]
        if not self.height * self.width:
            return np.zeros(0, dtype)
        shape, strides = (self.height, self.width), (self.row_step, self.point_step)
        return np.ndarray(shape, dtype, self.data.data, offset, strides).reshape(-1)


def _point_layout(message: Any) -> _Layout:
    """The checked layout of a cloud: every byte that it refers to is there."""
    height, width, step, row_step = message.height, message.width, message.point_step, message.row_step
    order = ">" if message.is_bigendian else "<"
    fields: dict[str, tuple[str, int]] = {}
    for field in message.fields:
        if field.name not in ("x", "y", "z", *TIME_FIELDS):
            continue
        if field.datatype not in _POINT_TYPES:
            raise DecodeError(f"PointCloud2: field {field.name} has datatype {field.datatype}, expected 1..8")
        if field.count > 1:
            raise DecodeError(f"PointCloud2: field {field.name} has {field.count} values per point, expected 1")
        dtype = order + _POINT_TYPES[field.datatype]
        if field.offset + np.dtype(dtype).itemsize > step:
            raise DecodeError(f"PointCloud2: field {field.name} at {field.offset} does not fit point_step {step}")
        fields[field.name] = (dtype, field.offset)
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        named = ", ".join(field.name for field in message.fields[:16]) or "none"
        raise DecodeError(f"PointCloud2: no field {', '.join(missing)} (fields: {named})")
    if height <= 1 or width == 0:
        row_step = max(row_step, width * step)  # one row has no next one: drivers that leave row_step 0 do no harm
    if row_step < width * step:
        raise DecodeError(f"PointCloud2: row_step {row_step} is less than width {width} x point_step {step}")
    needed = (height - 1) * row_step + width * step if height and width else 0
    if message.data.size < needed:
        raise DecodeError(f"PointCloud2: {height} x {width} points need {needed} bytes, there are {message.data.size}")
    if not needed:
        height = width = 0
    return _Layout(message.data, height, width, row_step, step, fields)


def _xyz(layout: _Layout) -> NDArray[np.float32]:
    """float32 [N, 3]; one strided copy where x, y, z are float32 neighbours, as in nearly every cloud."""
    (tx, ox), (ty, oy), (tz, oz) = (layout.fields[name] for name in "xyz")
    if layout.height * layout.width and tx == ty == tz and tx[1:] == "f4" and oy == ox + 4 and oz == ox + 8:
        shape, strides = (layout.height, layout.width, 3), (layout.row_step, layout.point_step, 4)
        view: NDArray[Any] = np.ndarray(shape, tx, layout.data.data, ox, strides)
        return np.array(view, np.float32, order="C").reshape(-1, 3)
    out = np.empty((layout.height * layout.width, 3), np.float32)
    for column, name in enumerate("xyz"):
        out[:, column] = layout.column(name)  # what float32 can't hold becomes infinite and is left out
    return out


# ------------------------------------------------------------------------------------------------------- camera
def decode_image(cdr: Bytes) -> CameraImage:
    """sensor_msgs/msg/Image: rgb8, bgr8, rgba8, bgra8, mono8, 8UC1, 8UC3, rows padded to any step. Raises DecodeError."""
    message = ros.read(cdr, ros.IMAGE)
    bgr = pictures.bgr_of_raw(message.data, message.height, message.width, message.step, message.encoding)
    return CameraImage(ros.stamp_of(message.header), ros.frame_of(message.header.frame_id), bgr)


def decode_compressed_image(cdr: Bytes) -> CameraImage:
    """sensor_msgs/msg/CompressedImage: JPEG or PNG (8 or 16 bit), told by its bytes, not by ``format``. Raises DecodeError."""
    message = ros.read(cdr, ros.COMPRESSED_IMAGE)
    bgr = pictures.bgr_of_file(message.data)
    return CameraImage(ros.stamp_of(message.header), ros.frame_of(message.header.frame_id), bgr)


@np.errstate(invalid="ignore", over="ignore")
def decode_camera_info(cdr: Bytes) -> CameraModel:
    """sensor_msgs/msg/CameraInfo, as it holds for the pictures sent: binning and region of interest are worked in.

    Raises DecodeError for a camera that is not calibrated (K of zeros) and for an unknown distortion model.
    """
    message = ros.read(cdr, ros.CAMERA_INFO)
    if not 0 < message.width <= 65535 or not 0 < message.height <= 65535:
        raise DecodeError(f"CameraInfo: size {message.width} x {message.height} is not a picture's")
    matrix = np.array(message.k, np.float64).reshape(3, 3)
    usable = (np.abs(matrix) < 1e7).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0 and (matrix[2] == (0, 0, 1)).all()
    if not usable:
        raise DecodeError(f"CameraInfo: K {matrix.ravel().tolist()} is not a calibrated pinhole camera's")
    if message.distortion_model not in _DISTORTION:
        raise DecodeError(f"CameraInfo: distortion model {message.distortion_model[:40]!r} is unknown")
    model, counts = _DISTORTION[message.distortion_model]
    distortion = np.array(message.d, np.float64)
    if distortion.size not in counts or not np.isfinite(distortion).all():
        raise DecodeError(
            f"CameraInfo: {model} needs {' or '.join(map(str, counts))} finite coefficients, got {distortion.size}"
        )
    if distortion.size == 8:
        model = "rational_polynomial"
    width, height = _apply_roi(message, matrix)
    return CameraModel(ros.frame_of(message.header.frame_id), width, height, matrix, model, distortion)


def _apply_roi(message: Any, matrix: NDArray[np.float64]) -> tuple[int, int]:
    """Moves ``matrix`` to the pixels of a cut out and binned picture (in place); returns its width and height."""
    roi, bin_x, bin_y = message.roi, max(1, message.binning_x), max(1, message.binning_y)
    width, height = roi.width or message.width, roi.height or message.height
    if roi.x_offset + width > message.width or roi.y_offset + height > message.height:
        if roi.width or roi.height:
            raise DecodeError("CameraInfo: the region of interest reaches out of the picture")
        width, height = message.width, message.height
    matrix[0, 2] -= roi.x_offset if roi.width else 0
    matrix[1, 2] -= roi.y_offset if roi.height else 0
    matrix[0] /= bin_x
    matrix[1] /= bin_y
    if width // bin_x < 1 or height // bin_y < 1:
        raise DecodeError(f"CameraInfo: binning {bin_x} x {bin_y} leaves no pixel")
    return width // bin_x, height // bin_y


# ------------------------------------------------------------------------------------------------------- poses
def decode_odometry(cdr: Bytes) -> OdomSample:
    """nav_msgs/msg/Odometry. Raises DecodeError for bytes, pose or frames that can't be."""
    return ros.decode_odometry(cdr)


def decode_tf(cdr: Bytes) -> list[StaticTransform]:
    """tf2_msgs/msg/TFMessage of fixed mountings (/tf_static); all of it or DecodeError."""
    out = []
    for entry in ros.read(cdr, ros.TF_MESSAGE).transforms:
        parent, child = ros.frame_of(entry.header.frame_id), ros.frame_of(entry.child_frame_id)
        if not parent or not child or parent == child:
            raise DecodeError(f"TF: {parent!r} -> {child!r} names no two frames")
        what = f"TF {parent} -> {child}"
        position = ros.vector_of(entry.transform.translation, what)
        out.append(StaticTransform(parent, child, make_pose(position, ros.quat_of(entry.transform.rotation, what))))
    return out


# ------------------------------------------------------------------------------------------------------- detections
def decode_detection_ids(cdr: Bytes) -> IdsImage:
    """The pixel half of detections: CompressedImage with a one-channel PNG of 8 or 16 bit. Raises DecodeError."""
    message = ros.read(cdr, ros.COMPRESSED_IMAGE)
    ids = pictures.numbers_of_png(message.data)
    return IdsImage(ros.stamp_of(message.header), ros.frame_of(message.header.frame_id), ids)


def decode_detections(ids_cdr: Bytes, info_json: bytes | str) -> Detections:
    """Both halves of one picture's detections. Raises DecodeError, also when they do not belong together."""
    ids = decode_detection_ids(ids_cdr)
    return build(ids.stamp_ns, ids.frame_id, ids.ids_px, parse_info(info_json))


# ------------------------------------------------------------------------------------------------------- by kind
@dataclass(frozen=True, slots=True)
class Kind:
    """What a topic carries. decode gives one value per message, tf_static one per mounting."""

    type_name: str
    decode: Callable[[Bytes], tuple[Sensed, ...]]


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "lidar": Kind(ros.POINT_CLOUD, lambda cdr: (decode_pointcloud2(cdr),)),
        "image": Kind(ros.IMAGE, lambda cdr: (decode_image(cdr),)),
        "image_compressed": Kind(ros.COMPRESSED_IMAGE, lambda cdr: (decode_compressed_image(cdr),)),
        "camera_info": Kind(ros.CAMERA_INFO, lambda cdr: (decode_camera_info(cdr),)),
        "odometry": Kind(ros.ODOMETRY, lambda cdr: (decode_odometry(cdr),)),
        "tf_static": Kind(ros.TF_MESSAGE, lambda cdr: tuple(decode_tf(cdr))),
    }
)


def decode(kind: str, cdr: Bytes) -> tuple[Sensed, ...]:
    """The values in one message of a kind (a key of ``KINDS``). Raises DecodeError for wrong bytes, KeyError for an unknown kind."""
    return KINDS[kind].decode(cdr)
