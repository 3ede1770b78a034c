"""A drawing of a graph over its plan: one list of shapes in map metres, written as SVG or as PNG."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.graph.codec import occupancy_to_png
from irsd.graph.model import GraphSnapshot

Point = tuple[float, float]
Colour = tuple[int, int, int]

PIXELS_PER_M = 60
MARGIN_M = 0.5
ROOM_PALETTE: tuple[Colour, ...] = (
    (141, 211, 199), (255, 237, 160), (190, 186, 218), (251, 180, 174), (128, 177, 211), (253, 205, 150),
    (179, 222, 105), (252, 205, 229), (204, 235, 197), (200, 200, 200),
)  # fmt: skip
INK: Colour = (30, 30, 30)
DOOR_COLOUR: Colour = (214, 96, 30)
PATH_COLOUR: Colour = (110, 30, 220)
GOAL_COLOUR: Colour = (200, 20, 20)


@dataclass(frozen=True, slots=True)
class Shape:
    """kind: polygon | polyline | disc | text. points in map metres; fill None draws the outline only."""

    kind: str
    points: tuple[Point, ...]
    stroke: Colour = INK
    fill: Colour | None = None
    opacity: float = 1.0
    width_px: float = 1.0
    text: str = ""
    size_px: float = 12.0


@dataclass(slots=True)
class Drawing:
    """Shapes over an optional occupancy background; grows its bounds as shapes are added."""

    shapes: list[Shape] = field(default_factory=list)
    background: tuple[GridFrame, NDArray[np.int8]] | None = None

    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) metres of everything drawn, with a margin."""
        points = [p for shape in self.shapes for p in shape.points]
        if self.background is not None:
            frame, cells = self.background
            seen = np.argwhere(cells >= 0)
            if len(seen):
                corners = frame.centres_of(np.array([seen.min(0), seen.max(0)]))
                points += [(float(x), float(y)) for x, y in corners]
        xy = np.array(points or [(0.0, 0.0)])
        (x0, y0), (x1, y1) = xy.min(0) - MARGIN_M, xy.max(0) + MARGIN_M
        return float(x0), float(y0), float(x1), float(y1)


def draw_graph(
    snapshot: GraphSnapshot,
    background: tuple[GridFrame, NDArray[np.int8]] | None = None,
    path: tuple[Point, ...] = (),
    goal: Point | None = None,
) -> Drawing:
    """Rooms as tinted polygons, doors as bars, instances as boxes with their names, a path and a goal if given."""
    out = Drawing(background=background)
    for index, room in enumerate(snapshot.rooms):
        colour = ROOM_PALETTE[index % len(ROOM_PALETTE)]
        out.shapes.append(
            Shape("polygon", room.polygon_xy, stroke=_darker(colour), fill=colour, opacity=0.45, width_px=2.5)
        )
    for thing in snapshot.instances:
        if thing.state != "gone":
            box = _box(thing.obb_center_m, thing.obb_size_m, thing.obb_yaw_rad)
            out.shapes.append(Shape("polygon", box, stroke=(70, 70, 90), fill=(255, 255, 255), opacity=0.6))
    for door in snapshot.doors:
        out.shapes.append(Shape("disc", (door.position_xy,), stroke=DOOR_COLOUR, fill=DOOR_COLOUR, size_px=5))
    if len(path) > 1:
        out.shapes.append(Shape("polyline", path, stroke=PATH_COLOUR, width_px=3))
    if goal is not None:
        out.shapes.append(Shape("disc", (goal,), stroke=GOAL_COLOUR, fill=GOAL_COLOUR, size_px=7))
    for thing in snapshot.instances:
        if thing.state != "gone":
            at = (thing.obb_center_m[0], thing.obb_center_m[1])
            out.shapes.append(Shape("text", (at,), text=f"{thing.id} {thing.label}", size_px=10))
    for room in snapshot.rooms:
        x0, _, x1, y1 = room.aabb_xy
        out.shapes.append(Shape("text", (((x0 + x1) / 2, y1 - 0.3),), text=f"{room.id} {room.label}", size_px=17))
    return out


def to_svg(drawing: Drawing) -> str:
    """The drawing as a self-contained SVG document; the background is embedded as PNG."""
    x0, y0, x1, y1 = drawing.bounds()
    scale = PIXELS_PER_M
    width, height = (x1 - x0) * scale, (y1 - y0) * scale

    def at(p: Point) -> str:
        return f"{(p[0] - x0) * scale:.1f},{(y1 - p[1]) * scale:.1f}"

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" font-family="sans-serif">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    if drawing.background is not None:
        frame, cells = drawing.background
        left, top = at((frame.origin_xy_m[0], frame.origin_xy_m[1] + frame.height * frame.resolution_m)).split(",")
        size = (frame.width * frame.resolution_m * scale, frame.height * frame.resolution_m * scale)
        data = base64.b64encode(occupancy_to_png(cells)).decode()
        parts.append(
            f'<image x="{left}" y="{top}" width="{size[0]:.1f}" height="{size[1]:.1f}" opacity="0.5" '
            f'style="image-rendering:pixelated" href="data:image/png;base64,{data}"/>'
        )
    for shape in drawing.shapes:
        stroke, fill = _css(shape.stroke), _css(shape.fill) if shape.fill else "none"
        paint = f'stroke="{stroke}" stroke-width="{shape.width_px}" fill="{fill}" fill-opacity="{shape.opacity}"'
        if shape.kind in ("polygon", "polyline"):
            parts.append(f'<{shape.kind} points="{" ".join(map(at, shape.points))}" {paint}/>')
        elif shape.kind == "disc":
            cx, cy = at(shape.points[0]).split(",")
            parts.append(f'<circle cx="{cx}" cy="{cy}" r="{shape.size_px}" {paint}/>')
        else:
            x, y = at(shape.points[0]).split(",")
            parts.append(
                f'<text x="{x}" y="{y}" font-size="{shape.size_px}" text-anchor="middle" fill="{stroke}">{escape(shape.text)}</text>'
            )
    return "\n".join([*parts, "</svg>\n"])


def to_png(drawing: Drawing) -> bytes:
    """The same drawing as PNG bytes."""
    x0, y0, x1, y1 = drawing.bounds()
    scale = PIXELS_PER_M
    height, width = int((y1 - y0) * scale), int((x1 - x0) * scale)
    canvas = np.full((height, width, 3), 255, np.uint8)

    def at(points: tuple[Point, ...]) -> NDArray[np.int32]:
        xy = np.asarray(points, np.float64).reshape(-1, 2)
        pixels: NDArray[np.int32] = np.rint(np.c_[(xy[:, 0] - x0) * scale, (y1 - xy[:, 1]) * scale]).astype(np.int32)
        return pixels

    if drawing.background is not None:
        _paint_background(canvas, drawing.background, (x0, y1), scale)
    for shape in drawing.shapes:
        pts = at(shape.points)
        stroke = shape.stroke[::-1]
        if shape.kind == "polygon":
            if shape.fill is not None:
                layer = canvas.copy()
                cv2.fillPoly(layer, [pts], shape.fill[::-1])
                cv2.addWeighted(layer, shape.opacity, canvas, 1 - shape.opacity, 0, canvas)
            cv2.polylines(canvas, [pts], True, stroke, max(1, round(shape.width_px)), cv2.LINE_AA)
        elif shape.kind == "polyline":
            cv2.polylines(canvas, [pts], False, stroke, max(1, round(shape.width_px)), cv2.LINE_AA)
        elif shape.kind == "disc":
            cv2.circle(canvas, pts[0].tolist(), round(shape.size_px), stroke, -1, cv2.LINE_AA)
        else:
            _paint_text(canvas, shape, pts[0])
    ok, data = cv2.imencode(".png", canvas)
    if not ok:
        raise ValueError(f"a picture of {width} x {height} pixels can't be encoded")
    return data.tobytes()


def _paint_text(canvas: NDArray[np.uint8], shape: Shape, at_px: NDArray[np.int32]) -> None:
    font, size = cv2.FONT_HERSHEY_SIMPLEX, shape.size_px / 26
    (w, _), _ = cv2.getTextSize(shape.text, font, size, 1)
    cv2.putText(
        canvas, shape.text, (int(at_px[0] - w // 2), int(at_px[1])), font, size, shape.stroke[::-1], 1, cv2.LINE_AA
    )


def _paint_background(
    canvas: NDArray[np.uint8], background: tuple[GridFrame, NDArray[np.int8]], top_left: Point, scale: float
) -> None:
    frame, cells = background
    grey = np.full(cells.shape, 235, np.uint8)
    grey[cells == 0] = 255
    grey[cells > 50] = 120
    affine = np.array(
        [
            [frame.resolution_m * scale, 0, (frame.origin_xy_m[0] - top_left[0]) * scale],
            [0, -frame.resolution_m * scale, (top_left[1] - frame.origin_xy_m[1]) * scale],
        ]
    )
    size = (canvas.shape[1], canvas.shape[0])
    warped = cv2.warpAffine(
        grey, affine, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=235
    )
    canvas[:] = warped[:, :, None]


def _box(center: tuple[float, float, float], size: tuple[float, float, float], yaw_rad: float) -> tuple[Point, ...]:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (np.array(size[:2]) / 2)
    corners = half @ np.array([[c, s], [-s, c]]) + np.array(center[:2])
    return tuple((float(x), float(y)) for x, y in corners)


def _css(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _darker(colour: Colour) -> Colour:
    r, g, b = (int(v * 0.55) for v in colour)
    return r, g, b
