"""``irsctl rooms`` on maps drawn here: label image, GeoJSON in map metres, clear errors."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from irsd.core.errors import ConfigError
from irsd.ctl.app import cli
from irsd.ctl.maps import load_map

RESOLUTION_M = 0.05


def draw_two_rooms(path: Path) -> np.ndarray:
    """A large room above a small one (in the picture), a 0.9 m door between them: uint8 [160, 140]."""
    image = np.full((160, 140), 205, np.uint8)
    image[10:90, 10:130] = 254  # 6 x 4 m
    image[94:150, 10:80] = 254  # 3.5 x 2.8 m
    image[90:94, 30:48] = 254
    assert cv2.imwrite(str(path), image)
    return image


def middle(polygon: np.ndarray) -> np.ndarray:
    """Centre of the bounding box."""
    return (polygon.min(0) + polygon.max(0)) / 2


def run(*arguments: str) -> str:
    result = CliRunner().invoke(cli, ["rooms", *arguments], standalone_mode=False)
    assert result.exception is None, result.output
    return result.stdout


def test_two_rooms_of_a_map_server_map(tmp_path: Path) -> None:
    image = draw_two_rooms(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text("image: map.png\nresolution: 0.05\norigin: [-2.0, 3.0, 0.0]\nnegate: 0\n")
    found = json.loads(run(str(tmp_path / "map.yaml"), "--out", str(tmp_path / "labels.png"), "--json"))
    assert found["rooms"] == 2
    labels = cv2.imread(str(tmp_path / "labels.png"), cv2.IMREAD_UNCHANGED)
    assert labels.dtype == np.uint16
    assert labels.shape == image.shape
    upper, lower = labels[50, 70], labels[120, 40]
    assert {upper, lower} == {1, 2}
    shapes = json.loads((tmp_path / "labels.geojson").read_text())["features"]
    rooms = {
        f["properties"]["id"]: np.array(f["geometry"]["coordinates"][0])
        for f in shapes
        if f["properties"]["kind"] == "room"
    }
    # the picture's top row is the largest y: y = 3.0 + (160 - row) * 0.05
    np.testing.assert_allclose(middle(rooms[f"R{upper}"]), [-2.0 + 70 * 0.05, 3.0 + 110 * 0.05], atol=0.2)
    np.testing.assert_allclose(middle(rooms[f"R{lower}"]), [-2.0 + 45 * 0.05, 3.0 + 38 * 0.05], atol=0.2)
    assert [f["properties"]["kind"] for f in shapes].count("opening") == 1
    picture = cv2.imread(found["picture"])
    assert len({tuple(picture[50, 70]), tuple(picture[120, 40]), tuple(picture[2, 2])}) == 3


def test_a_bare_picture_has_the_usual_scale(tmp_path: Path) -> None:
    draw_two_rooms(tmp_path / "map.png")
    with_scale = json.loads(
        run(str(tmp_path / "map.png"), "--resolution", "0.05", "--out", str(tmp_path / "a.png"), "--json")
    )
    without = json.loads(run(str(tmp_path / "map.png"), "--out", str(tmp_path / "b.png"), "--json"))
    assert with_scale["rooms"] == without["rooms"] == 2


@pytest.mark.parametrize(("name", "content", "named"), [
    ("a.png", b"no picture", "not a picture"),
    ("a.yaml", b"image: nowhere.png\nresolution: 0.05\n", "nowhere.png"),
    ("a.yaml", b"resolution: 0.05\n", "image missing"),
    ("a.yaml", b"{", "is not YAML"),
])  # fmt: skip
def test_wrong_files_are_named(tmp_path: Path, name: str, content: bytes, named: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigError, match=named):
        load_map(tmp_path / name, None)


def test_dark_is_free_where_the_map_is_negated(tmp_path: Path) -> None:
    image = draw_two_rooms(tmp_path / "map.png")
    assert cv2.imwrite(str(tmp_path / "negated.png"), 255 - image)
    (tmp_path / "n.yaml").write_text("image: negated.png\nresolution: 0.1\nnegate: 1\n")
    read, resolution_m, origin = load_map(tmp_path / "n.yaml", None)
    assert ((read >= 250) == (image == 254)).all()
    assert (resolution_m, origin) == (0.1, (0.0, 0.0))
