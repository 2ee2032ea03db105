"""SDF <include>: the models of a world or model, its own and the models of other files.

In: a `Node` that holds models; folders of models (`model_folders`). Out: models, each with the <include> that
places it.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Iterator, NamedTuple, Optional
from urllib.parse import unquote

from husky_highlevel_controller.datatypes import IDENTITY
from husky_highlevel_controller.simulator.models.mesh_file import model_folders
from husky_highlevel_controller.simulator.models.sdf_parser import (
    NEWEST,
    VERSIONS,
    Node,
    minor_version,
    open_sdf,
)
from husky_highlevel_controller.simulator.models.sdf_xml import WorldError, parse_xml, read_bytes

# Model of the ground in every Gazebo world: a static plane, of which 100 m x 100 m are drawn
# (osrf/gazebo_models, ground_plane).
_GROUND_PLANE = """<sdf version="1.7"><model name="ground_plane"><static>true</static><link name="link">
<collision name="ground"><geometry><plane><size>100 100</size></plane></geometry></collision>
<visual name="ground"><geometry><plane><size>100 100</size></plane></geometry></visual>
</link></model></sdf>"""
# addresses of the models ground plane and sun on Fuel (app.gazebosim.org); this program knows both models, so
# it needs no network for them
_FUEL_GROUND_OR_SUN = re.compile(
    r"https?://[^/]+/1\.0/[^/]+/models/(ground[ _]plane|sun)(/.*)?", re.IGNORECASE
)


class Model(NamedTuple):
    """A <model>, and the <include> that places it, if one does."""

    node: Node
    include: Optional[Node] = None

    def child(self, tag: str) -> Optional[Node]:
        """The child of a tag: the include's comes before the model's own."""
        return (self.include and self.include.child(tag)) or self.node.child(tag)

    @property
    def name(self) -> str:
        """Name by the include, or otherwise the model's own."""
        given = self.include.child("name") if self.include else None
        return (given.text if given else "") or self.node.named()


def models_in(holder: Node) -> Iterator[Model]:
    """The models of a world or model, in the order of its file."""
    for node in holder.children():
        if node.tag == "model":
            yield Model(node)
        elif node.tag == "include":
            # the results are kept, because the models of one world or model are listed several times
            included, element = node.load.included, node.element
            if element not in included:
                included[element] = _included(node)
            model = included[element]
            if model:
                yield Model(model, include=node)


def _included(include: Node) -> Optional[Node]:
    """Return the model that an <include> names; None if there is nothing to add.

    There is nothing to add for a lamp. If the include is not supported, or its model is not on this machine,
    a note says so. A file that is included several times is read once.
    """
    include.note_unknown()
    pose = include.child("pose")
    if pose:
        # a broken pose is replaced here; otherwise it would be an error later, when the pose of the model is
        # read
        pose.unless_broken(pose.pose, IDENTITY, "a <pose> that cannot be read is left out")
    uri_node = include.child("uri")
    if uri_node is None:
        include.note("an <include> without a <uri> is left out")
        return None
    uri = uri_node.text
    # the ground plane and the sun on Fuel are the same as in Gazebo, and this program needs no file for them
    fuel_address = _FUEL_GROUND_OR_SUN.fullmatch(unquote(uri))
    if fuel_address:
        uri = "model://" + fuel_address.group(1).lower().replace(" ", "_")
    if uri == "model://sun":
        return None
    if uri == "model://ground_plane":
        return open_sdf(_GROUND_PLANE, uri, include.load).required("model")
    if not uri.startswith("model://"):
        include.note("an <include> of anything but model:// is not supported and is left out", uri)
        return None
    path, files = _find_model(uri, include.source), include.load.files
    if path is None:
        # because of these counts, a warning may say that the lidar sees nothing
        include.load.model_count += 1
        include.load.missed_by_lidar += 1
        include.note(
            "a model that is not on this machine is left out; add its folder to GAZEBO_MODEL_PATH",
            uri,
        )
        return None
    if str(path) not in files:
        files[str(path)] = open_sdf(read_bytes(path), str(path), include.load)
    root = files[str(path)]
    model = root.child("model")
    # a file with only a light, such as model://sun, causes no warning, because the robot cannot touch a light
    if model is None and not root.child("light"):
        include.note("an <include> of a file without a <model> is left out", uri)
    return model


def _find_model(uri: str, source: str) -> Optional[Path]:
    """The newest SDF file of a model that can be read here; None if there is none on this machine."""
    name = uri[len("model://") :].strip("/")
    if not name:
        return None
    for folder in model_folders(name, source):
        # a model.config names a file for each version of SDF; without a model.config, model.sdf counts
        config = Path(os.path.realpath(os.path.join(folder, "model.config")))
        plain = Path(os.path.realpath(os.path.join(folder, "model.sdf")))
        newest = _newest_file(config, plain) if os.path.isfile(config) else plain
        if os.path.isfile(newest):
            return newest
    return None


def _newest_file(config: Path, plain: Path) -> Path:
    """Return the best of the SDF files that a model.config offers, each for a version of SDF.

    That is the file for the newest version up to NEWEST, or for the oldest version if all are newer. If the
    model.config cannot be read or offers nothing, it is `plain`.

    Args:
        config: path of the model.config.
        plain: path of the model.sdf in the same folder.

    Raises:
        WorldError: the model.config offers only versions of SDF that are not read.
    """
    try:
        offers = list(parse_xml(read_bytes(config), str(config)).iter("sdf"))  # <sdf version="1.6">FILE</sdf>
    except WorldError:
        offers = []
    if not offers:
        return plain
    # VERSIONS has all versions that can be read; files up to SDF 1.NEWEST are read completely. A file that
    # is offered without a version counts as the oldest version.
    readable = [sdf for sdf in offers if sdf.get("version", VERSIONS[0]) in VERSIONS]
    # if no file has a readable version, all files are used, and `minor_version` raises the error about the
    # first one
    name_by_minor_version = {
        minor_version(str(config), sdf.get("version", VERSIONS[0])): sdf.text for sdf in readable or offers
    }
    # the newest version that is not after NEWEST; if there is none, the oldest version after NEWEST
    best = min(name_by_minor_version, key=lambda minor: (minor > NEWEST, abs(minor - NEWEST)))
    return config.parent / (name_by_minor_version[best] or "").strip()
