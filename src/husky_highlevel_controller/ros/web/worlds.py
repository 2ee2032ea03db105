"""World files as models that a simulator can spawn one by one.

In: the text of an SDF world. Out: names and SDF texts.
"""

from __future__ import annotations

from typing import List, NamedTuple
from xml.etree.ElementTree import Element, ParseError, SubElement, tostring

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from husky_highlevel_controller.datatypes import HuskyError

GROUND = "ground_plane"
LIGHT = "model://sun"


class Model(NamedTuple):
    """A model of a world, its pose within its text."""

    name: str
    xml: str


def models(text: str, source: str) -> List[Model]:
    """The models of a world in their order, without ground and sun.

    Raises:
        HuskyError: the text is no SDF world.
    """
    try:
        root = fromstring(text)
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise HuskyError(f"{source} is not XML: {error}") from None
    world = root.find("world")
    if world is None:
        raise HuskyError(f"{source} holds no <world>")
    version = root.get("version", "1.6")
    found = [Model(model.get("name", ""), _sdf(model, version)) for model in world.findall("model")]
    for include in world.findall("include"):
        uri = include.findtext("uri", "").strip()
        if uri not in (LIGHT, f"model://{GROUND}"):
            raise HuskyError(f"{source} includes {uri}, which cannot be loaded while the simulator runs")
    return found


def _sdf(model: Element, version: str) -> str:
    sdf = Element("sdf", version=version)
    wrapper = SubElement(sdf, "model", name=model.get("name", ""))
    wrapper.extend(list(model))
    return tostring(sdf, encoding="unicode")
