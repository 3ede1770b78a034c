"""Decoding against an independent writer of point clouds (struct, point by point) and against OpenCV's own files."""

from __future__ import annotations

import contextlib
import struct
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.core.errors import DecodeError
from irsd.core.geometry import make_pose
from irsd.core.types import CameraImage, CameraModel, LidarScan, StaticTransform
from irsd.io import cdr as ros
from irsd.sensors import encode
from irsd.sensors.decode import (
    KINDS,
    decode,
    decode_camera_info,
    decode_compressed_image,
    decode_detection_ids,
    decode_image,
    decode_pointcloud2,
    decode_tf,
)

STAMP_NS = 1_700_000_000_250_000_000
CODES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


@dataclass(frozen=True)
class Cloud:
    """A PointCloud2 to be written slowly and plainly. fields: (name, datatype, offset) with all numbers in ``points`` by name."""

    fields: tuple[tuple[str, int, int], ...]
    points: tuple[dict[str, float], ...]
    point_step: int
    height: int = 1
    row_padding: int = 0
    big: bool = False
    dense: bool = True

    def cdr(self, **changes: object) -> bytes:
        width = len(self.points) // self.height
        row_step = width * self.point_step + self.row_padding
        data = bytearray(b"\xa5" * (row_step * self.height))
        order = ">" if self.big else "<"
        for k, point in enumerate(self.points):
            at = (k // width) * row_step + (k % width) * self.point_step
            for name, datatype, offset in self.fields:
                struct.pack_into(order + CODES[datatype], data, at + offset, point[name])
        fields = [ros.make(ros.POINT_FIELD, name=n, datatype=d, offset=o, count=1) for n, d, o in self.fields]
        values: dict[str, object] = {
            "header": ros.make_header(STAMP_NS, "/lidar"),
            "height": self.height,
            "width": width,
            "fields": fields,
            "is_bigendian": self.big,
            "point_step": self.point_step,
            "row_step": row_step,
            "data": np.frombuffer(bytes(data), np.uint8),
            "is_dense": self.dense,
        }
        return ros.write(ros.make(ros.POINT_CLOUD, **(values | changes)))


@st.composite
def clouds(draw: st.DrawFn) -> Cloud:
    """Any order of fields, any number types, gaps between fields, padding after points and rows, either byte order."""
    names = draw(st.permutations(["x", "y", "z", "intensity", "ring"]))
    fields, offset = [], draw(st.integers(0, 3))
    for name in names:
        datatype = draw(st.sampled_from(sorted(CODES)))
        fields.append((name, datatype, offset))
        offset += struct.calcsize("<" + CODES[datatype]) + draw(st.integers(0, 3))
    height = draw(st.integers(1, 3))
    count = height * draw(st.integers(0, 4))
    coordinate = {
        d: st.floats(-500, 500, width=32) if d >= 7 else st.integers(*((-9, 99) if d in (1, 3, 5) else (0, 99)))
        for d in CODES
    }
    points = tuple({name: draw(coordinate[d]) for name, d, _ in fields} for _ in range(count))
    return Cloud(
        tuple(fields), points, offset + draw(st.integers(0, 5)), height, draw(st.integers(0, 7)), draw(st.booleans())
    )


@given(clouds())
def test_any_layout_is_read(cloud: Cloud) -> None:
    expected = [[p["x"], p["y"], p["z"]] for p in cloud.points if (p["x"], p["y"], p["z"]) != (0, 0, 0)]
    scan = decode_pointcloud2(cloud.cdr())
    assert (scan.stamp_ns, scan.frame_id, scan.time_offset_s) == (STAMP_NS, "lidar", None)
    assert scan.points_sensor.dtype == np.float32
    assert scan.points_sensor.flags.c_contiguous
    np.testing.assert_array_equal(scan.points_sensor, np.array(expected, np.float32).reshape(-1, 3))


@given(clouds(), st.data())
def test_altered_clouds_only_raise_decode_error(cloud: Cloud, data: st.DataObject) -> None:
    altered = bytearray(cloud.cdr())
    for _ in range(data.draw(st.integers(1, 3))):
        altered[data.draw(st.integers(0, len(altered) - 1))] = data.draw(st.integers(0, 255))
    try:
        scan = decode_pointcloud2(bytes(altered))
    except DecodeError:
        return
    assert np.isfinite(scan.points_sensor).all()
    assert len(scan.points_sensor) <= len(altered)


XYZ = (("x", 7, 0), ("y", 7, 4), ("z", 7, 8))
ONE = Cloud(XYZ, ({"x": 1.0, "y": 2.0, "z": 3.0},), 12)


def test_an_empty_cloud_is_a_scan() -> None:
    for cloud in (Cloud(XYZ, (), 12), Cloud((*XYZ, ("time", 7, 12)), (), 16)):
        assert decode_pointcloud2(cloud.cdr()).points_sensor.shape == (0, 3)


@pytest.mark.parametrize("dense", [True, False])
def test_points_that_are_none_are_left_out_with_their_time(dense: bool) -> None:
    points = tuple(
        {"x": x, "y": 1.0, "z": 0.0, "time": t} for x, t in [(1.0, 0.0), (np.nan, 0.01), (np.inf, 0.02), (4.0, 0.03), (5.0, np.nan)]
    )  # fmt: skip
    origin = ({"x": 0.0, "y": 0.0, "z": 0.0, "time": 0.05},)
    scan = decode_pointcloud2(Cloud((*XYZ, ("time", 7, 12)), points + origin, 16, dense=dense).cdr())
    assert scan.points_sensor[:, 0].tolist() == [1.0, 4.0]
    assert scan.time_offset_s is not None
    np.testing.assert_allclose(scan.time_offset_s, [0.0, 0.03], atol=1e-7)


def test_signalling_nans_are_dropped_without_a_warning() -> None:
    cloud = bytearray(Cloud(XYZ, ONE.points * 2, 12).cdr())
    at = bytes(cloud).index(struct.pack("<f", 3.0))
    cloud[at : at + 4] = struct.pack("<I", 0x7F800001)
    assert len(decode_pointcloud2(bytes(cloud)).points_sensor) == 1


def test_a_double_that_float32_can_not_hold_is_left_out() -> None:
    cloud = Cloud(
        (("x", 8, 0), ("y", 8, 8), ("z", 8, 16)), ({"x": 1e300, "y": 0.0, "z": 0.0}, {"x": 1.0, "y": 0.0, "z": 0.0}), 24
    )
    assert decode_pointcloud2(cloud.cdr()).points_sensor.tolist() == [[1.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("cloud", "changes", "says"),
    [
        (ONE, {"width": 2**31}, "row_step|need"),
        (ONE, {"width": 2**31, "row_step": 2**32 - 1}, "need"),
        (ONE, {"height": 2**32 - 1}, "need"),
        (ONE, {"width": 2, "row_step": 24}, "need 24 bytes, there are 12"),
        (ONE, {"height": 2, "row_step": 4}, "row_step 4"),
        (ONE, {"point_step": 11}, "field z at 8 does not fit point_step 11"),
        (ONE, {"point_step": 0}, "does not fit"),
        (ONE, {"fields": []}, "no field x, y, z"),
        (replace(ONE, fields=XYZ[:2]), {}, "no field z"),
        (ONE, {"fields": [ros.make(ros.POINT_FIELD, name="x", datatype=9, offset=0, count=1)]}, "datatype 9"),
        (ONE, {"fields": [ros.make(ros.POINT_FIELD, name="x", datatype=7, offset=0, count=3)]}, "3 values"),
    ],
)
def test_a_cloud_that_lies_is_refused_with_the_reason(cloud: Cloud, changes: dict[str, object], says: str) -> None:
    with pytest.raises(DecodeError, match=says):
        decode_pointcloud2(cloud.cdr(**changes))


def test_row_step_of_a_single_row_does_not_matter() -> None:
    assert len(decode_pointcloud2(ONE.cdr(row_step=0)).points_sensor) == 1


@given(st.integers(0, 50), st.booleans())
def test_our_own_clouds_come_back(count: int, timed: bool) -> None:
    rng = np.random.default_rng(count)
    points = rng.uniform(0.1, 9, (count, 3)).astype(np.float32)
    times = rng.uniform(0, 0.2, count).astype(np.float32) if timed else None
    got = decode_pointcloud2(encode.encode_pointcloud2(LidarScan(STAMP_NS, "lidar", points, times)))
    np.testing.assert_array_equal(got.points_sensor, points)
    assert (got.time_offset_s is None) == (not timed)
    if times is not None and got.time_offset_s is not None:
        np.testing.assert_allclose(got.time_offset_s, times, atol=1e-7)


# --------------------------------------------------------------------------------------------------------- pictures
def picture(height: int = 24, width: int = 40) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([x * 5, y * 9, (x + y) * 3], -1).astype(np.uint8)


@given(
    st.sampled_from(["rgb8", "bgr8", "mono8", "rgba8", "bgra8", "8UC1", "8UC3"]),
    st.integers(1, 9),
    st.integers(1, 9),
    st.integers(0, 5),
)
def test_raw_pictures_of_any_step(encoding: str, height: int, width: int, padding: int) -> None:
    channels = {"mono8": 1, "8UC1": 1, "rgba8": 4, "bgra8": 4}.get(encoding, 3)
    pixels = np.random.default_rng(height * 10 + width).integers(0, 255, (height, width, channels), np.uint8)
    rows = np.full((height, width * channels + padding), 77, np.uint8)
    rows[:, : width * channels] = pixels.reshape(height, -1)
    got = decode_image(raw_image(rows.reshape(-1), height, width, rows.shape[1], encoding)).bgr
    expected = {"rgb": pixels[..., 2::-1], "bgr": pixels[..., :3], "mon": np.repeat(pixels, 3, -1)}
    bgr = expected[encoding[:3]] if encoding[0] != "8" else (pixels if channels == 3 else np.repeat(pixels, 3, -1))
    np.testing.assert_array_equal(got, bgr)


def raw_image(data: np.ndarray, height: int, width: int, step: int, encoding: str) -> bytes:
    header = ros.make_header(STAMP_NS, "camera_optical")
    return ros.write(ros.make(ros.IMAGE, header=header, height=height, width=width, encoding=encoding, is_bigendian=0,
                              step=step, data=data))  # fmt: skip


@pytest.mark.parametrize(
    ("height", "width", "step", "encoding", "says"),
    [
        (0, 4, 12, "bgr8", "no picture"),
        (2, 4, 11, "bgr8", "step 11"),
        (3, 4, 12, "bgr8", "needs 36 bytes, there are 24"),
        (2**31, 2**31, 2**32 - 1, "bgr8", "more than"),
        (2, 4, 12, "bayer_rggb8", "bayer_rggb8"),
    ],
)
def test_raw_pictures_that_lie(height: int, width: int, step: int, encoding: str, says: str) -> None:
    with pytest.raises(DecodeError, match=says):
        decode_image(raw_image(np.zeros(24, np.uint8), height, width, step, encoding))


def compressed(file: bytes, file_format: str = "jpeg") -> bytes:
    header = ros.make_header(STAMP_NS, "camera_optical")
    return ros.write(
        ros.make(ros.COMPRESSED_IMAGE, header=header, format=file_format, data=np.frombuffer(file, np.uint8))
    )


def test_png_comes_back_exactly_and_jpeg_closely() -> None:
    image = CameraImage(STAMP_NS, "camera_optical", picture())
    np.testing.assert_array_equal(decode_compressed_image(encode.encode_compressed_image(image, "png")).bgr, image.bgr)
    jpeg = decode_compressed_image(encode.encode_compressed_image(image)).bgr
    assert np.abs(jpeg.astype(int) - image.bgr).mean() < 3
    np.testing.assert_array_equal(decode_image(encode.encode_image(image)).bgr, image.bgr)


def test_16_bit_png_as_picture_and_as_numbers() -> None:
    numbers = (np.arange(24 * 40).reshape(24, 40) * 60).astype(np.uint16)
    file = compressed(cv2.imencode(".png", numbers)[1].tobytes(), "16UC1; png compressed")
    assert decode_compressed_image(file).bgr[3, 7].tolist() == [numbers[3, 7] >> 8] * 3
    np.testing.assert_array_equal(decode_detection_ids(file).ids_px, numbers)


def test_numbers_in_colour_or_jpeg_are_refused() -> None:
    for suffix, says in ((".png", "one channel"), (".jpg", "not a PNG")):
        with pytest.raises(DecodeError, match=says):
            decode_detection_ids(compressed(cv2.imencode(suffix, picture())[1].tobytes()))


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_file_that_is_cut_is_refused(suffix: str) -> None:
    file = cv2.imencode(suffix, picture(200, 300))[1].tobytes()
    for length in (0, 5, 30, len(file) // 2, len(file) - 20):
        with pytest.raises(DecodeError, match="CompressedImage"):
            decode_compressed_image(compressed(file[:length]))


def test_a_header_that_claims_gigabytes_is_refused() -> None:
    png = bytearray(cv2.imencode(".png", picture())[1].tobytes())
    png[16:24] = struct.pack(">II", 60000, 60000)
    jpeg = bytearray(cv2.imencode(".jpg", picture())[1].tobytes())
    at = jpeg.index(b"\xff\xc0")
    jpeg[at + 5 : at + 9] = struct.pack(">HH", 60000, 60000)
    for file in (png, jpeg):
        with pytest.raises(DecodeError, match="claim 60000 x 60000"):
            decode_compressed_image(compressed(bytes(file)))


@settings(max_examples=60)
@given(st.sampled_from([".jpg", ".png"]), st.data())
def test_altered_files_only_raise_decode_error(suffix: str, data: st.DataObject) -> None:
    file = bytearray(cv2.imencode(suffix, picture())[1].tobytes())
    for _ in range(data.draw(st.integers(1, 3))):
        file[data.draw(st.integers(0, len(file) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(DecodeError):
        assert decode_compressed_image(compressed(bytes(file))).bgr.dtype == np.uint8


# --------------------------------------------------------------------------------------------------------- camera, TF
CAMERA = CameraModel(
    "cam", 640, 480, np.array([[417.0, 0, 319.5], [0, 417.0, 239.5], [0, 0, 1]]), "plumb_bob", np.zeros(5)
)


@pytest.mark.parametrize(
    ("model", "count"), [("plumb_bob", 5), ("rational_polynomial", 8), ("equidistant", 4), ("plumb_bob", 0)]
)
def test_camera_info_comes_back(model: str, count: int) -> None:
    camera = replace(CAMERA, model=model, distortion=np.linspace(-0.1, 0.1, count))
    got = decode_camera_info(encode.encode_camera_info(camera, STAMP_NS))
    assert (got.frame_id, got.width_px, got.height_px, got.model) == ("cam", 640, 480, model)
    np.testing.assert_array_equal(got.matrix, camera.matrix)
    np.testing.assert_array_equal(got.distortion, camera.distortion)


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        (replace(CAMERA, matrix=np.zeros((3, 3))), "calibrated"),
        (replace(CAMERA, matrix=np.full((3, 3), np.nan)), "calibrated"),
        (replace(CAMERA, model="my_lens"), "my_lens"),
        (replace(CAMERA, distortion=np.zeros(3)), "got 3"),
        (replace(CAMERA, distortion=np.full(5, np.inf)), "finite"),
        (replace(CAMERA, width_px=0), "0 x 480"),
    ],
)
def test_cameras_that_can_not_be(camera: CameraModel, says: str) -> None:
    with pytest.raises(DecodeError, match=says):
        decode_camera_info(encode.encode_camera_info(camera, STAMP_NS))


def test_binning_and_region_of_interest_move_the_camera() -> None:
    message = ros.read(encode.encode_camera_info(CAMERA, STAMP_NS), ros.CAMERA_INFO)
    roi = ros.make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=100, y_offset=80, width=400, height=300, do_rectify=False
    )
    message = replace(message, roi=roi, binning_x=2, binning_y=2)
    got = decode_camera_info(ros.write(message))
    assert (got.width_px, got.height_px) == (200, 150)
    np.testing.assert_allclose(got.matrix, [[208.5, 0, 109.75], [0, 208.5, 79.75], [0, 0, 1]])


def test_mountings_come_back_and_wrong_ones_are_refused() -> None:
    mounts = [
        StaticTransform("base_link", "lidar", make_pose(np.array([0.1, 0.2, 0.6]), np.array([0.1, 0.2, 0.3, 0.9])))
    ]
    assert decode_tf(encode.encode_tf([])) == []
    (got,) = decode_tf(encode.encode_tf(mounts))
    assert (got.parent, got.child) == ("base_link", "lidar")
    np.testing.assert_allclose(got.parent_T_child, mounts[0].parent_T_child, atol=1e-12)
    for wrong in (replace(mounts[0], child="base_link"), replace(mounts[0], parent="")):
        with pytest.raises(DecodeError, match="names no two frames"):
            decode_tf(encode.encode_tf([wrong]))


def test_every_kind_reads_its_own_message_and_no_other() -> None:
    files = {
        "lidar": ONE.cdr(),
        "image": encode.encode_image(CameraImage(STAMP_NS, "cam", picture())),
        "image_compressed": encode.encode_compressed_image(CameraImage(STAMP_NS, "cam", picture())),
        "camera_info": encode.encode_camera_info(CAMERA, STAMP_NS),
        "tf_static": encode.encode_tf([StaticTransform("a", "b", np.eye(4))]),
    }
    assert set(files) == set(KINDS) - {"odometry"}
    for kind, cdr in files.items():
        assert len(decode(kind, cdr)) == 1
        for other in set(files) - {kind}:
            with pytest.raises(DecodeError):
                decode(other, cdr)
