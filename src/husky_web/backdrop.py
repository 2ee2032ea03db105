"""Backdrop of the 3D view: ground, sky and light by day and by night, contact shadows.

Ground and sky are triangles with colours at their corners. Without a graphics card, a shader that calculates
a grid takes as long as ground and sky together, and so does a texture. Shadows would take a second per frame.
"""

from __future__ import annotations

from math import cos, pi, radians, sin
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import trimesh
import viser

from husky_highlevel_controller.datatypes import Pose, Vector3
from husky_web.viser_private import place, show_in_page

SIDES = 48  # number of straight sides of each circle of the ground and of the sky
RADIUS = 400.0  # [m] distance from the robot to the horizon
# Haze covers the ground more and more with the distance. The share of the haze's colour in the colour of the
# ground is NEAR_HAZE_SHARE at the distance NEAR_HAZE [m], and 1 at the horizon.
NEAR_HAZE, NEAR_HAZE_SHARE = 120.0, 0.75
# [m] up to CHECKER from the robot, the ground has a checker pattern; it has a line every SECTION, and LINE is
# half the width of a line
CHECKER, SECTION, LINE = 25, 5, 0.03
# near the robot, a square of the checker pattern is brighter or darker than the ground's colour by this
# fraction
CONTRAST = 0.09
# [m] length after which the pattern repeats. The ground follows the robot in steps of this length, so the
# pattern looks the same after each step.
PATTERN_LENGTH = 2 * SECTION
SHADOW_HEIGHT = 0.004  # [m] height of the shadow above the ground
# shadow of the robot or an object: distance [m] from the outline of the robot or object to the edge of the
# shadow, side of the shadow's picture [px], largest opacity (0 to 1)
SHADOW_BLUR, SHADOW_PIXELS, SHADOW_OPACITY = 0.22, 96, 0.55
UNLIT = "KHR_materials_unlit"
# linear red, green and blue; they may exceed 1, because the browser's tone mapping reduces them to colours of
# the screen
Colour = Tuple[float, float, float]


class Look(NamedTuple):
    """Colours and lights of one backdrop."""

    ground: Colour
    haze: Colour  # colour of the ground at the horizon
    horizon: Colour  # colour of the sky at the horizon
    zenith: Colour
    # fraction by which a line on the ground is brighter than the ground; negative if it is darker
    line: float
    sun: float  # intensity of the directional light
    sky: float  # intensity of the light from above and below


LOOKS = {
    "day": Look((0.74, 0.77, 0.80), (0.80, 0.97, 1.18), (0.95, 1.2, 1.5), (0.10, 0.30, 0.85), -0.5, 2.4, 2.6),
    "night": Look(
        (0.045, 0.05, 0.058), (0.045, 0.057, 0.08), (0.05, 0.065, 0.095), (0.004, 0.007, 0.015), 1.2, 2.0, 1.8
    ),
}


class Backdrop:
    """Ground, sky and lights of all pages; each page shows either the day or the night."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the day and the night to the scene; the day is visible at first."""
        # viser's own lights are switched off, because day and night have lights of their own
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        for name, look in LOOKS.items():
            scene.add_frame(f"/{name}", show_axes=False, visible=name == "day")
            scene.add_light_directional(f"/{name}/sun", intensity=look.sun, position=(-4.0, 3.0, 8.0))
            scene.add_light_hemisphere(f"/{name}/light", ground_color=(150, 150, 150), intensity=look.sky)
        self._scenery = [
            scene.add_glb(f"/{name}/scenery", scenery(look), receive_shadow=False)
            for name, look in LOOKS.items()
        ]

    def update(self, ground: float, robot: Optional[Vector3]) -> None:
        """Put the ground at a height [m], around the robot [m], without a visible shift of its pattern."""
        x, y = (0.0, 0.0) if robot is None else robot[:2]
        # the ground moves only by whole lengths of its pattern
        x = PATTERN_LENGTH * round(x / PATTERN_LENGTH)
        y = PATTERN_LENGTH * round(y / PATTERN_LENGTH)
        for node in self._scenery:
            place(node, Pose((x, y, ground)))


def show_backdrop(client: viser.ClientHandle, is_dark: bool) -> None:
    """Show the backdrop of the night, or of the day, to one page."""
    shown = "night" if is_dark else "day"
    for name in LOOKS:
        show_in_page(client, f"/{name}", name == shown)


def contact_shadow(scene: viser.SceneApi, name: str, size: Sequence[float], center: Vector3) -> Any:
    """Add a blurred dark rectangle below an object with this outline (x, y) [m], as a child of its node."""
    width, depth = (float(side) + 2.0 * SHADOW_BLUR for side in size[:2])
    alpha = np.outer(_fade(depth), _fade(width))
    image = np.zeros((SHADOW_PIXELS, SHADOW_PIXELS, 4), np.uint8)
    image[..., 3] = (255.0 * SHADOW_OPACITY * alpha).round()
    return scene.add_image(name, image, width, depth, format="png", position=center, cast_shadow=False)


def _fade(length: float) -> np.ndarray:
    """Return the opacity along a side of the shadow, from 0 at both ends to 1 in the middle.

    `length` [m] is the length of the side. The opacity reaches 1 at a distance of twice SHADOW_BLUR from the
    ends, or in the middle of a short side.
    """
    # [m] distance of each pixel from the middle of the side, and from its nearer end
    from_middle = np.abs(np.linspace(-length / 2.0, length / 2.0, SHADOW_PIXELS))
    from_end = length / 2.0 - from_middle
    linear = np.clip(from_end / min(2.0 * SHADOW_BLUR, length / 2.0), 0.0, 1.0)
    # The linear opacity would change its slope abruptly at 0 and at 1, which is visible as an edge. This
    # curve is level there.
    smooth: np.ndarray = linear * linear * (3.0 - 2.0 * linear)
    return smooth


def scenery(look: Look) -> bytes:
    """Return ground, with a checker of 1 m and lines every SECTION, and sky as a binary glTF."""
    near_quads, near_colors = checker(look)
    far_quads, far_colors = _surroundings(look)
    # corners [m] of N four-sided faces (quads), and colours of the corners; each is an array (N, 4, 3)
    quads = np.concatenate([near_quads, far_quads])
    colors = np.concatenate([near_colors, far_colors])
    # all colours are divided by the largest value, because glTF allows colours only up to 1; the material of
    # the mesh multiplies the colours by this value again
    brightness = float(colors.max())
    rgb = np.round(255.0 * colors / brightness).astype(np.uint8).reshape(-1, 3)
    # (N, 2, 3) two triangles for each quad, each with the indices of its three corners
    faces = 4 * np.arange(len(quads))[:, None, None] + np.array([(0, 1, 2), (0, 2, 3)])
    mesh = trimesh.Trimesh(quads.reshape(-1, 3), faces.reshape(-1, 3), vertex_colors=rgb, process=False)

    def make_unlit(tree: Dict[str, Any]) -> None:
        """Change the parts of the glTF file, so that the browser draws the colours as if without lights."""
        tree["extensionsUsed"] = [UNLIT]
        factor = {"baseColorFactor": [brightness, brightness, brightness, 1.0]}
        tree["materials"] = [{"pbrMetallicRoughness": factor, "doubleSided": True, "extensions": {UNLIT: {}}}]
        tree["meshes"][0]["primitives"][0]["material"] = 0

    data: Any = mesh.export(file_type="glb", tree_postprocessor=make_unlit)
    return bytes(data)


def checker(look: Look) -> Tuple[np.ndarray, np.ndarray]:
    """Return quads (N, 4, 3) [m] and colours (N, 4, 3) of the ground near the robot, with the checker.

    Farther away a checker would flicker.
    """
    # [m] limits of the columns of quads along x; the rows along y have the same limits. There is one limit at
    # each metre, but two limits at a line, because a line is a narrow column.
    limits: List[float] = []
    for metre in range(-CHECKER, CHECKER + 1):
        if metre % SECTION == 0:
            limits += [metre - LINE, metre + LINE]
        else:
            limits.append(metre)
    low, high = np.array(limits[:-1]), np.array(limits[1:])  # lower and upper limit of each column
    is_line = high - low < 0.5  # a line is 2 * LINE wide, and another column is about 1 m wide
    # (N,) arrays with a number for each quad, row by row; (x0, y0) is the corner of the quad with the
    # smallest x and y, and (x1, y1) is the opposite corner
    x0, y0 = _all_pairs(low)
    x1, y1 = _all_pairs(high)
    is_column_line, is_row_line = _all_pairs(is_line)
    center_x, center_y = (x0 + x1) / 2.0, (y0 + y1) / 2.0
    colors = _checker_colors(look, center_x, center_y, is_column_line | is_row_line)
    z = np.zeros_like(x0)  # the ground is level
    corners = np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])
    # the axes (corner, coordinate, quad) become (quad, corner, coordinate); the four corners of a quad get
    # the colour of the quad
    return corners.transpose(2, 0, 1), np.repeat(colors[:, None], 4, axis=1)


def _all_pairs(values: np.ndarray) -> np.ndarray:
    """Return (2, N): the value of the column and the value of the row of each quad, row by row.

    `values` has a value for each column; the rows have the same values.
    """
    return np.reshape(np.meshgrid(values, values), (2, -1))


def _checker_colors(look: Look, x: np.ndarray, y: np.ndarray, is_line: np.ndarray) -> np.ndarray:
    """Return the colour (N, 3) of each quad of the checker.

    Args:
        look: colours of the backdrop.
        x: (N,) [m] position of each quad's centre.
        y: (N,) [m] position of each quad's centre.
        is_line: (N,) true if the quad is a part of a line.
    """
    is_odd = (np.floor(x) + np.floor(y)) % 2.0  # 0 or 1; neighbours along x or along y have different values
    # fraction by which each quad is brighter than the ground: CONTRAST and -CONTRAST by turns, except on
    # lines
    brightness = np.where(is_line, look.line, CONTRAST * (1.0 - 2.0 * is_odd))
    # strength of the pattern at each quad: 1 at the robot, 0 at the end of the pattern and beyond
    strength = np.clip(1.0 - np.hypot(x, y) / CHECKER, 0.0, 1.0)
    colors: np.ndarray = (1.0 + brightness * strength)[:, None] * np.array(look.ground)
    return colors


def _surroundings(look: Look) -> Tuple[np.ndarray, np.ndarray]:
    """Return quads (N, 4, 3) [m] and colours (N, 4, 3) of the ground beyond the checker, and of the sky.

    The quads lie between rings of SIDES points. Each ring has one colour.
    """
    angles = np.linspace(0.0, 2.0 * pi, SIDES + 1)
    # (SIDES + 1, 3) points of a circle with the radius 1; its last point is its first point again, so that
    # the ring is closed
    circle = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    # from the rim of the checker outwards to the horizon, and then up the dome of the sky
    rings = _ground_rings(look, circle) + _sky_rings(look, circle)
    points = np.array([ring for ring, _ in rings])  # (rings, SIDES + 1, 3)
    colors = np.array([np.broadcast_to(color, ring.shape) for ring, color in rings])
    return _quads_between(points), _quads_between(colors)


def _ground_rings(look: Look, circle: np.ndarray) -> List[Tuple[np.ndarray, Colour]]:
    """Return the points [m] and the colour of each ring on the ground, the inner rings first.

    `circle` has the points of a circle with the radius 1.
    """
    # each point of the circle is moved outwards to the square around it, of which one coordinate is 1 or -1
    square = circle / np.abs(circle).max(axis=1, keepdims=True)
    return [
        # a little inside and below the square rim of the checker, so that no gap is visible
        ((CHECKER - 0.5) * square - (0.0, 0.0, 0.01), look.ground),
        (NEAR_HAZE * circle, _mix(look.ground, look.haze, NEAR_HAZE_SHARE)),
        (RADIUS * circle, look.haze),
    ]


def _sky_rings(look: Look, circle: np.ndarray) -> List[Tuple[np.ndarray, Colour]]:
    """Return the points [m] and the colour of each ring of the sky's dome, from the horizon upwards.

    `circle` has the points of a circle with the radius 1. The ring at the horizon has the points of the last
    ring of the ground, but another colour, so the colour changes abruptly there.
    """
    rings = []
    # elevation [deg] of each ring, and fraction of the zenith's colour in its colour; chosen by eye
    for elevation, share in ((0, 0.0), (4, 0.12), (10, 0.3), (20, 0.55), (35, 0.8), (60, 0.96), (90, 1.0)):
        angle = radians(elevation)
        ring = RADIUS * cos(angle) * circle + RADIUS * sin(angle) * np.array((0.0, 0.0, 1.0))
        rings.append((ring, _mix(look.horizon, look.zenith, share)))
    return rings


def _quads_between(rings: np.ndarray) -> np.ndarray:
    """Return the corners (N, 4, 3) of the quads between rings (R, P, 3), of either positions or colours."""
    # rings at the inner and at the outer side of each band of quads
    inner, outer = rings[:-1], rings[1:]
    corners = [inner[:, :-1], inner[:, 1:], outer[:, 1:], outer[:, :-1]]
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def _mix(a: Colour, b: Colour, share: float) -> Colour:
    """Return the mixture of two colours; `share` is the fraction of the second one, 0 to 1."""
    x, y, z = ((1.0 - share) * p + share * q for p, q in zip(a, b))
    return (x, y, z)
