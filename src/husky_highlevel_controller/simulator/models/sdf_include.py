"""SDF <include>: lists the models of a world or model, also the models that an <include> adds from a file.

In: a `Node` that holds models; folders of models (`model_folders`). Out: models, each with the <include> that
adds it.
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
# addresses of the models ground plane and sun on Fuel, the model server of Gazebo (app.gazebosim.org). Most
# worlds include both, so they are read without the network: see `_included`.
_FUEL_GROUND_OR_SUN = re.compile(
    r"https?://[^/]+/1\.0/[^/]+/models/(ground[ _]plane|sun)(/.*)?", re.IGNORECASE
)


class Model(NamedTuple):
    """A model in a world or in another model."""

    node: Node  # element <model>
    include: Optional[Node] = None  # <include> that adds the model; None if there is no <include>

    @property
    def pose(self) -> Optional[Node]:
        """Element <pose> of the <include>; if there is none, the <pose> of the <model>; None without both."""
        return self._child("pose")

    @property
    def static(self) -> Optional[Node]:
        """Element <static> of the <include>; if there is none, that of the <model>; None without both."""
        return self._child("static")

    def _child(self, tag: str) -> Optional[Node]:
        """Return the first child with a tag, from the <include> if it has one, otherwise from the <model>."""
        child = self.include.child(tag) if self.include else None
        return child or self.node.child(tag)

    @property
    def name(self) -> str:
        """Name of the model: the name in the <include>; if there is none, the name in the <model>."""
        name_in_include = self.include.child("name") if self.include else None
        if name_in_include and name_in_include.text:
            return name_in_include.text
        return self.node.named()


def models_in(holder: Node) -> Iterator[Model]:
    """Yield the models of a world or model, in the order of the file."""
    for node in holder.children():
        if node.tag == "model":
            yield Model(node)
        elif node.tag == "include":
            # this function is called several times for one world or model, but reads each <include> only once
            known_models, element = node.load.included, node.element
            if element not in known_models:
                known_models[element] = _included(node)
            model = known_models[element]
            if model:
                yield Model(model, include=node)


def _included(include: Node) -> Optional[Node]:
    """Return the element <model> that an <include> adds; None if there is nothing to add.

    There is nothing to add for a lamp. If the include is not supported, or its model is not on this machine,
    a note says so. A file that is included several times is read once.
    """
    include.note_unknown()
    pose = include.child("pose")
    if pose:
        # The pose is read here only to note a broken one, because the <include> may add no model. If it adds
        # a model at a broken pose, `FrameScope.pose_of` raises the error later.
        pose.unless_broken(pose.pose, IDENTITY, "a <pose> that cannot be read is left out")
    uri_node = include.child("uri")
    if uri_node is None:
        include.note("an <include> without a <uri> is left out")
        return None
    uri = uri_node.text
    # the ground plane and the sun on Fuel are the same models as model://ground_plane and model://sun
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
        # These two numbers are for the warning that the lidar sees nothing. This model is one of the world's
        # models, and the lidar would see it if it were not left out.
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
    """Return the SDF file of a model://NAME in the newest readable version; None if there is no file.

    `source` is the path of the file that contains the URI.
    """
    name = uri[len("model://") :].strip("/")
    if not name:
        return None
    for folder in model_folders(name, source):
        # The folder of a model has a model.config, which names a file for each version of SDF. Without a
        # model.config, the file is model.sdf. Links are followed, so that each file has one path and is read
        # once.
        config = Path(os.path.realpath(os.path.join(folder, "model.config")))
        plain = Path(os.path.realpath(os.path.join(folder, "model.sdf")))
        newest = _newest_file(config, plain) if os.path.isfile(config) else plain
        if os.path.isfile(newest):
            return newest
    return None


def _newest_file(config: Path, plain: Path) -> Path:
    """Return the best of the SDF files that a model.config names, one for each version of SDF.

    The best file is that of the newest version up to NEWEST, or of the oldest version if all are newer. If
    the model.config cannot be read or names no file, the result is `plain`.

    Args:
        config: path of the model.config.
        plain: path of the model.sdf in the same folder.

    Raises:
        WorldError: the model.config has only versions of SDF that cannot be read.
    """
    try:
        listed = list(parse_xml(read_bytes(config), str(config)).iter("sdf"))  # <sdf version="1.6">FILE</sdf>
    except WorldError:
        listed = []
    if not listed:
        return plain
    oldest = VERSIONS[0]  # a file without a version counts as the oldest version
    readable = [sdf for sdf in listed if sdf.get("version", oldest) in VERSIONS]
    if not readable:
        # all are kept, so that `minor_version` below raises the error about the first of these versions
        readable = listed
    file_by_minor = {minor_version(str(config), sdf.get("version", oldest)): sdf.text for sdf in readable}
    # versions up to NEWEST are better than all versions after NEWEST; among them, the nearest to NEWEST is
    # the best
    best = min(file_by_minor, key=lambda minor: (minor > NEWEST, abs(minor - NEWEST)))
    return config.parent / (file_by_minor[best] or "").strip()
