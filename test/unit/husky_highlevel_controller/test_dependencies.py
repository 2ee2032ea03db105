"""A dependency that is misspelt is told with the package that is meant; libraries of the system are none."""

from xml.etree import ElementTree

import pytest

from husky_highlevel_controller.dependencies import (
    UnknownDependency,
    dependencies_of,
    dependency_sentence,
    unknown_dependencies,
)

KNOWN = {"catkin", "geometry_msgs", "kdl_conversions", "rospy", "sensor_msgs", "std_msgs"}


@pytest.mark.parametrize(
    ("dependency", "suggestion"),
    [
        ("sensor_msg", "sensor_msgs"),
        ("geometry_masgs", "geometry_msgs"),
        ("geometrymsgs", "geometry_msgs"),
        ("rosspy", "rospy"),
        ("pcl_conversions", ""),
        ("no_such_package", ""),
    ],
)
def test_a_dependency_that_is_no_package_is_told(dependency, suggestion):
    (finding,) = unknown_dependencies("mine", ["rospy", dependency], KNOWN)
    assert finding == UnknownDependency("mine", dependency, suggestion)
    told = dependency_sentence(finding)
    assert f"'mine' depends on '{dependency}', which is not a package here" in told
    assert (f"did you mean '{suggestion}'?" in told) == bool(suggestion)


@pytest.mark.parametrize("name", ["boost", "eigen", "python3-numpy", "libpcl-all-dev", "yaml-cpp", "rospy"])
def test_a_library_of_the_system_is_none(name):
    assert unknown_dependencies("mine", [name], KNOWN) == []


def test_the_dependencies_of_a_manifest_are_read_from_each_tag():
    text = "<package><depend> b </depend><exec_depend>a</exec_depend><depend/><name>c</name></package>"
    assert dependencies_of(ElementTree.fromstring(text)) == ["a", "b"]
