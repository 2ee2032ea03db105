#!/usr/bin/env python3
"""The program xacro of PyPI, which asks ROS 2 for $(find PACKAGE); here rospkg answers.

Stands in for the ROS package xacro only, because the program is the original.
"""

import sys
import types
import xml.parsers.expat  # noqa: F401 - xacro takes it for imported when a file is missing

import rospkg

sys.path.pop(0)  # folder in which this file would be taken for the library
packages = types.ModuleType("ament_index_python.packages")
packages.get_package_share_directory = rospkg.RosPack().get_path
sys.modules["ament_index_python"] = types.ModuleType("ament_index_python")
sys.modules["ament_index_python.packages"] = packages

import xacro  # noqa: E402 - after what it asks

xacro.main()
