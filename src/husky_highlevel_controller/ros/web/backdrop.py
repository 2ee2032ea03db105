"""Backdrop of the 3D view: ground, sky and light by day and by night, and contact shadows.

Shadows are pictures: without a graphics card those of lights take a second a frame.
"""

from __future__ import annotations

import json
import struct
from math import cos, pi, radians, sin
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

import numpy as np
import viser

from husky_highlevel_controller.datatypes import Vector3
from husky_highlevel_controller.ros.web.viser_private import show_in_page

SIDES = 48  # of the ground's disc and of the sky's dome
RADIUS = 400.0  # [m] from the origin to the horizon
SHADOW_HEIGHT, GRID_HEIGHT = 0.004, 0.012  # [m] above the ground, so that none hides the other
# of shadows: [m] beyond the outline; side of the picture; at the darkest
SHADOW_BLUR, SHADOW_PIXELS, SHADOW_OPACITY = 0.22, 96, 0.55
Colour = Tuple[float, float, float]  # linear, before the browser's tone mapping


class Look(NamedTuple):
    """Colours and lights of one backdrop."""

    ground: Colour
    haze: Colour  # of the ground at the horizon
    horizon: Colour  # of the sky at the horizon
    zenith: Colour
    cell: Tuple[int, int, int]  # grid lines of 1 m, sRGB
    section: Tuple[int, int, int]  # of 5 m
    sun: float  # intensity of the directional light
    sky: float  # of the light from above and below


LOOKS = {
    "day": Look(
        (0.74, 0.77, 0.80), (0.80, 0.97, 1.18), (0.95, 1.2, 1.5), (0.10, 0.30, 0.85),
        (175, 181, 188), (130, 138, 148), 2.4, 2.6,
    ),
    "night": Look(
        (0.045, 0.05, 0.058), (0.045, 0.057, 0.08), (0.05, 0.065, 0.095), (0.004, 0.007, 0.015),
        (74, 80, 88), (98, 106, 118), 2.0, 1.8,
    ),
}  # fmt: skip


class Backdrop:
    """Ground, sky and lights of every page; each page shows those of the day or of the night."""

    def __init__(self, scene: viser.SceneApi) -> None:
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        self._grids, self._domes = [], []
        for name, look in LOOKS.items():
            scene.add_frame(f"/{name}", show_axes=False, visible=name == "day")
            scene.add_light_directional(f"/{name}/sun", intensity=look.sun, position=(-4.0, 3.0, 8.0))
            scene.add_light_hemisphere(f"/{name}/light", ground_color=(150, 150, 150), intensity=look.sky)
            self._domes.append(scene.add_glb(f"/{name}/dome", dome(look), receive_shadow=False))
            self._grids.append(
                scene.add_grid(
                    f"/{name}/grid",
                    cell_size=1.0,
                    section_size=5.0,
                    cell_color=look.cell,
                    section_color=look.section,
                    infinite_grid=True,
                    fade_distance=60.0,
                    shadow_opacity=0.0,
                )
            )

    def update(self, ground: float, has_grid: bool) -> None:
        """Put the ground at a height [m], with or without its grid."""
        for grid, the_dome in zip(self._grids, self._domes):
            grid.visible = has_grid
            if abs(grid.position[2] - GRID_HEIGHT - ground) > 1e-6:
                grid.position = (0.0, 0.0, ground + GRID_HEIGHT)
                the_dome.position = (0.0, 0.0, ground)


def show_backdrop(client: viser.ClientHandle, is_dark: bool) -> None:
    """Show the backdrop of the night, or of the day, to one page."""
    for name in LOOKS:
        show_in_page(client, f"/{name}", is_dark == (name == "night"))


def contact_shadow(scene: viser.SceneApi, name: str, size: Sequence[float], center: Vector3) -> Any:
    """Add a blurred dark rectangle below a body of this outline (x, y) [m], as a child of its node."""
    width, depth = (float(side) + 2.0 * SHADOW_BLUR for side in size[:2])
    alpha = np.outer(_fade(depth), _fade(width))
    image = np.zeros((SHADOW_PIXELS, SHADOW_PIXELS, 4), np.uint8)
    image[..., 3] = (255.0 * SHADOW_OPACITY * alpha).round()
    return scene.add_image(name, image, width, depth, format="png", position=center, cast_shadow=False)


def _fade(length: float) -> np.ndarray:
    """Opacity along a side of the shadow [m]: 0 at its ends, 1 from twice the blur inwards."""
    from_end = length / 2.0 - np.abs(np.linspace(-length / 2.0, length / 2.0, SHADOW_PIXELS))
    t = np.clip(from_end / min(2.0 * SHADOW_BLUR, length / 2.0), 0.0, 1.0)
    smooth: np.ndarray = t * t * (3.0 - 2.0 * t)
    return smooth


def dome(look: Look) -> bytes:
    """Disc of the ground and dome of the sky, as a binary glTF of unlit triangles."""
    rings: List[Tuple[float, float, Colour]] = [
        (0.0, 0.0, look.ground),
        (30.0, 0.0, look.ground),
        (120.0, 0.0, _mix(look.ground, look.haze, 0.75)),
        (RADIUS, 0.0, look.haze),
    ]
    for elevation, share in ((0, 0.0), (4, 0.12), (10, 0.3), (20, 0.55), (35, 0.8), (60, 0.96), (90, 1.0)):
        angle = radians(elevation)
        color = _mix(look.horizon, look.zenith, share)
        rings.append((RADIUS * cos(angle), RADIUS * sin(angle), color))
    angles = np.linspace(0.0, 2.0 * pi, SIDES, endpoint=False)
    vertices = [(r * cos(a), r * sin(a), z) for r, z, _ in rings for a in angles]
    colors = [color for _, _, color in rings for _ in angles]
    faces = []
    for ring in range(len(rings) - 1):
        for side in range(SIDES):
            a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
            faces += [(a, b, b + SIDES), (a, b + SIDES, a + SIDES)]
    return _unlit_glb(np.array(vertices, "<f4"), np.array(colors, "<f4"), np.array(faces, "<u4"))


def _mix(a: Colour, b: Colour, share: float) -> Colour:
    x, y, z = ((1.0 - share) * p + share * q for p, q in zip(a, b))
    return (x, y, z)


def _unlit_glb(vertices: np.ndarray, colors: np.ndarray, faces: np.ndarray) -> bytes:
    """Binary glTF 2.0 of one mesh with KHR_materials_unlit; glTF's own axes are undone by its reader."""
    views: List[Dict[str, int]] = []
    accessors: List[Dict[str, Any]] = []
    payload = b""
    for array, kind, number in ((vertices, "VEC3", 5126), (colors, "VEC3", 5126), (faces, "SCALAR", 5125)):
        count = array.size if kind == "SCALAR" else len(array)
        accessors.append({"bufferView": len(views), "componentType": number, "count": count, "type": kind})
        views.append({"buffer": 0, "byteOffset": len(payload), "byteLength": array.nbytes})
        payload += array.tobytes()
    accessors[0].update(min=vertices.min(axis=0).tolist(), max=vertices.max(axis=0).tolist())
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}
    unlit: Dict[str, Any] = {"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [unlit],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(payload)}],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(payload), b"BIN\0") + payload
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
