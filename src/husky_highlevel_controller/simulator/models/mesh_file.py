"""Mesh files of worlds and objects: they are searched, read by trimesh, and kept within limits of size.

In: the URI of a .dae, .stl or .obj file, and the file that contains it. Out: a `TriangleMesh`, or a
`MeshError`.

As in Gazebo classic, the unit that a .dae file states has an effect, but its up axis has no effect.
"""

from __future__ import annotations

import io
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, Iterator, List, Tuple
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import numpy as np

from husky_highlevel_controller.datatypes import HuskyError, TriangleMesh
from husky_highlevel_controller.meshes import make_mesh, simplified
from husky_highlevel_controller.paths import search_path
from husky_highlevel_controller.simulator.models.collada_size import SceneSize, scene_size
from husky_highlevel_controller.simulator.models.sdf_xml import WorldError, parse_xml, read_bytes

ENDINGS = (".dae", ".stl", ".obj")
MAX_BYTES = 50_000_000  # [bytes] largest size of a mesh file
MAX_BYTES_IN_ALL = 200_000_000  # [bytes] largest size of all mesh files of a world together
# largest number of nodes of a .dae file; a node that is used several times counts several times
MAX_NODES = 20_000
# largest number of triangles of a .dae file; a mesh that is used several times counts several times
MAX_TRIANGLES = 3_000_000
MAX_FACES = 100_000  # largest number of faces of a mesh; a mesh with more faces is made coarser


class MeshError(HuskyError):
    """A mesh cannot be used.

    The text is a sentence without its subject, such as "is not on this machine". The caller puts "a mesh" in
    front of the text.
    """


@dataclass
class MeshFiles:
    """Mesh files of one world, each read once."""

    bytes_left: int = MAX_BYTES_IN_ALL  # [bytes] total size of the files that may still be read
    # meshes that were read, by file and by name of the part (empty for the whole file)
    known: Dict[Tuple[Path, str], TriangleMesh] = field(default_factory=dict)
    coarser: List[str] = field(default_factory=list)  # names of the files whose meshes were made coarser

    def read(self, uri: str, source: str, part: str = "") -> TriangleMesh:
        """Return the mesh of a file, or one named part of it.

        Args:
            uri: model://, package://, file://, or a path.
            source: path of the file that contains the URI; a relative path begins in its folder.
            part: name of a <submesh>; empty for the whole file.

        Raises:
            MeshError: the file is missing, not a mesh, or too large.
        """
        path = find_mesh(uri, source)
        if (path, part) in self.known:
            return self.known[path, part]
        if path.suffix.lower() not in ENDINGS:
            raise MeshError(f"is not a file of a supported type ({', '.join(ENDINGS)})")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise MeshError(f"has {size / 1e6:.0f} MB, above the limit of {MAX_BYTES / 1e6:.0f} MB")
        if size > self.bytes_left:
            raise MeshError(f"exceeds the limit of {MAX_BYTES_IN_ALL / 1e6:.0f} MB for all meshes together")
        self.bytes_left -= size
        mesh = load_mesh(path, part)
        if len(mesh.faces) > MAX_FACES:
            # the world loader names these files in one warning
            self.coarser.append(f"{path.name} ({len(mesh.faces)})")
            mesh = simplified(mesh, MAX_FACES)
        self.known[path, part] = mesh
        return mesh


def load_mesh(path: Path, part: str = "") -> TriangleMesh:
    """Return the triangles of a mesh file [m].

    Args:
        path: the file.
        part: name of the only part that is read, from a <submesh>; empty for the whole file.

    Raises:
        MeshError: the file holds no triangles that can be read.
    """
    try:
        import trimesh
    except ImportError:
        raise MeshError("needs the Python package trimesh, which is not installed") from None
    ending = path.suffix.lower()
    unit = 1.0  # [m] length of the file's unit; only a .dae file can state another unit
    try:
        data = read_bytes(path)
        if ending == ".dae":
            document = parse_xml(data, str(path))
            unit = _unit_of(document)
            # A small .dae file can become a large scene, because it can use one mesh many times. So the size
            # of the scene is computed before trimesh builds the scene.
            _check_size(scene_size(document))
        # "scene" keeps the names of the parts; without "process", trimesh does not change the vertices
        options: Dict[str, Any] = {"force": "scene", "process": False, "skip_materials": True}
        scene: Any = trimesh.load(io.BytesIO(data), file_type=ending[1:], **options)
        vertices, faces = _parts_of(scene, part)
    except MeshError:  # `_check_size` raises it; the last `except` below would change its text
        raise
    except WorldError as error:
        raise MeshError(f"cannot be read: {error}") from None
    except Exception as error:  # trimesh raises errors of many types for a broken file
        raise MeshError(f"cannot be read: {type(error).__name__}: {error}") from None
    if not len(faces):
        raise MeshError(f"holds no part '{part}'" if part else "holds no triangles")
    if not np.isfinite(vertices).all():
        raise MeshError("has corners that are not finite")
    mesh = make_mesh(vertices * unit, faces, path.name)
    if not len(mesh.faces):
        raise MeshError("holds no triangles with an area")
    return mesh


def _check_size(size: SceneSize) -> None:
    """Raise MeshError for a scene that would take too much time and memory."""
    if size.nodes > MAX_NODES:
        raise MeshError(f"has more than {MAX_NODES} nodes if each of its instances counts")
    if size.corners > 3 * MAX_TRIANGLES:
        raise MeshError(f"has more than {MAX_TRIANGLES} triangles if each of its instances counts")


def _unit_of(document: ElementTree.Element) -> float:
    """Return the length of a COLLADA file's unit [m]; 1 m if the file states no valid unit."""
    unit = document.find("{*}asset/{*}unit")  # {*} is any XML namespace
    length = float("nan" if unit is None else unit.get("meter", "nan"))
    return length if 0.0 < length < float("inf") else 1.0  # the comparison is false for nan


def _parts_of(scene: Any, part: str) -> Tuple[np.ndarray, np.ndarray]:
    """Return corners (V, 3) and faces (F, 3) of the meshes in a trimesh scene, in the scene's frame and unit.

    `part` is the name of the only mesh that is returned; empty for all meshes.
    """
    # the empty arrays are for a scene without meshes, because `concatenate` needs at least one array
    corners: List[np.ndarray] = [np.empty((0, 3))]
    faces: List[np.ndarray] = [np.empty((0, 3), int)]
    corner_count = 0  # number of corners of the meshes so far
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]  # pose (4, 4) of the mesh in the scene, and name of the mesh
        mesh = scene.geometry[name]
        has_triangles = hasattr(mesh, "faces")  # a scene may also have lines and points
        is_part = not part or name.partition("-mesh")[0] == part  # Blender calls the mesh of a node NODE-mesh
        if has_triangles and is_part:
            rotation, translation = transform[:3, :3], transform[:3, 3]
            corners.append(mesh.vertices @ rotation.T + translation)
            # A face has the indices of its corners. The corners of this mesh are added after those of the
            # meshes before, so their indices become larger by `corner_count`.
            faces.append(np.asarray(mesh.faces) + corner_count)
            corner_count += len(mesh.vertices)
    return np.concatenate(corners), np.concatenate(faces)


def find_mesh(uri: str, source: str) -> Path:
    """Return the file of the URI of a mesh. Raises MeshError if the file is not on this machine.

    `model://NAME/...` and `package://NAME/...` are searched in GAZEBO_MODEL_PATH, in ROS_PACKAGE_PATH, and in
    the folders above the file `source`, which contains the URI. A relative path is searched next to `source`,
    then in GAZEBO_RESOURCE_PATH.
    """
    try:
        for path in _places(uri, source):
            if path.is_file():
                return Path(os.path.realpath(path))
    except (OSError, ValueError):  # the URI contains characters that no file name can have
        pass
    raise MeshError("is not on this machine")


def _places(uri: str, source: str) -> Iterator[Path]:
    """Yield the paths at which the file of a URI may be, see `find_mesh`, in the order of the search.

    A URI of any other scheme, such as http, has no path.
    """
    parts = urlsplit(uri)
    if parts.scheme in ("model", "package"):
        path_in_folder = unquote(parts.path).lstrip("/")
        for folder in model_folders(parts.netloc, source):
            yield folder / path_in_folder
    elif parts.scheme in ("", "file"):
        path = unquote(uri.partition("://")[2] if parts.scheme else uri)
        source_folder = Path(os.path.abspath(source)).parent
        for folder in (source_folder, *search_path("GAZEBO_RESOURCE_PATH")):
            yield folder / path  # `path` itself if it is an absolute path


def model_folders(name: str, source: str) -> Iterator[Path]:
    """Yield the folders in which a model or package may be, in the order of the search.

    1. FOLDER/NAME for each FOLDER in GAZEBO_MODEL_PATH and ROS_PACKAGE_PATH
    2. each folder above the source whose own name is NAME, then each such FOLDER in the two paths
    3. FOLDER/NAME for each FOLDER above the source
    4. FOLDER/models/NAME for the nearest three folders above the source

    Args:
        name: name of the model or package.
        source: path of the file that contains the name.
    """
    above = list(Path(os.path.abspath(source)).parents)  # the nearest folder first
    search_folders = [*search_path("GAZEBO_MODEL_PATH"), *search_path("ROS_PACKAGE_PATH")]
    yield from (folder / name for folder in search_folders)
    yield from (folder for folder in (*above, *search_folders) if folder.name == name)
    yield from (folder / name for folder in above)
    yield from (folder / "models" / name for folder in above[:3])
