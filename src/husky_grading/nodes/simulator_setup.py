"""Parameters and remappings of the simulator, read from its launch file, as JSON; nothing is started."""

from __future__ import annotations

import json
import sys

import roslaunch


def main() -> None:
    """Print the parameters and remappings as JSON; arguments are `FILE.launch [name:=value ...]`."""
    config = roslaunch.config.ROSLaunchConfig()
    file, *arguments = sys.argv[1:]
    roslaunch.xmlloader.XmlLoader().load(file, config, argv=["roslaunch", *arguments], verbose=False)
    (node,) = config.nodes  # the simulator is the only node, because `grade` switches RViz off
    parameters = {name: parameter.value for name, parameter in config.params.items()}
    arguments = [f"{name}:={value}" for name, value in node.remap_args]
    print(json.dumps({"parameters": parameters, "arguments": arguments}))
