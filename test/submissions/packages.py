"""Makes packages of the nodes here, as students hand them in. By hand: packages.py FOLDER [NAME ...]."""

import re
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
WITH_FAULT = "has_a_fault"  # node of the packages that are called as its faults
FAULTS = [
    "counts_ids", "creeps", "cuts_to_whole_metres", "drives_away", "forgets_y", "hides_its_displays",
    "includes_a_missing_file", "is_for_an_older_husky", "listens_elsewhere", "listens_to_laser",
    "marks_in_base_link", "marks_itself", "marks_nan", "marks_the_origin", "marks_twice", "never_turns",
    "rams", "spins", "starts_a_map_server", "swaps_x_and_y", "takes_another_beam", "turns_too_slowly",
]  # fmt: skip
NODES = [*FAULTS, *(path.name for path in HERE.iterdir() if path.is_file() and not path.suffix)]
NODES.remove(WITH_FAULT)
FOLDERS = sorted(path.name for path in HERE.iterdir() if (path / "package.xml").is_file())
IN_CPP = {  # `drives_in_cpp` with some text in place of another
    "does_not_build": ("ros::spin();", "ros::spin(); int oops = ;"),
    "keeps_no_subscriber": (
        '  ros::Subscriber scans = node.subscribe("/front/scan", 1, onScan);',
        '  { ros::Subscriber scans = node.subscribe("/front/scan", 1, onScan); }',
    ),
}
# the others have no configuration, and no points for it
WITH_RVIZ = {
    "complete", "hides_its_displays", "hooks_the_setup", "includes_a_missing_file", "marks_the_origin",
}  # fmt: skip
AS_ROSOUT = "forges_the_truth"  # its node has the name of one that every ROS network has

MANIFEST = (
    '<package format="2"><name>{}</name><version>0.0.0</version><description>A submission.</description>'
    '<maintainer email="{}">student</maintainer><license>BSD</license>{}</package>'
)
CMAKE = """cmake_minimum_required(VERSION 3.0.2)
project({name})
find_package(catkin REQUIRED)
catkin_package()
catkin_install_python(PROGRAMS scripts/controller DESTINATION ${{CATKIN_PACKAGE_BIN_DESTINATION}})
"""
LAUNCH = '<launch>\n  <node name="{node}" pkg="{name}" type="controller" output="screen"/>{more}\n</launch>\n'
FAULT = '\n  <param name="controller/fault" value="{name}"/>'
MORE = {  # in a launch file
    # a world and a program that are not installed are not a cause
    "commands_zero": '\n  <include file="$(find office_gazebo)/launch/office.launch"/>',
    "starts_a_map_server": '\n  <node name="map" pkg="map_server" type="map_server" args="office.yaml"/>',
    "includes_a_missing_file": '\n  <include file="$(find {name})/launch/other.launch"/>',
}
RVIZ = '\n  <node name="rviz" pkg="rviz" type="rviz" args="-d $(find {name})/rviz/view.rviz"/>'


def put(path, text=""):
    """Write a file and the folders above it; its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def manifest(name, *depends, tag="depend", email="student@example.org"):
    """Text of a package.xml."""
    return MANIFEST.format(name, email, "".join(f"<{tag}>{each}</{tag}>" for each in depends))


def make_package(name, folder, student=""):
    """A package of this name in a folder, or in the student's; its node runs without a build."""
    package = Path(folder) / (student or name)
    if name in IN_CPP:
        package = make_package("drives_in_cpp", folder, student or name)
        code = package / "src" / "controller.cpp"
        code.write_text(code.read_text().replace(*IN_CPP[name]))
    elif name in FOLDERS:
        shutil.copytree(HERE / name, package)
        if name in WITH_RVIZ:
            shutil.copy(HERE / "view.rviz", package)
    else:
        for part in ("launch", "scripts", "rviz"):
            (package / part).mkdir(parents=True)
        (package / "package.xml").write_text(manifest(name, "catkin", tag="buildtool_depend"))
        (package / "CMakeLists.txt").write_text(CMAKE.format(name=name))
        rviz = RVIZ.format(name=name) if name in WITH_RVIZ else ""
        more = rviz + MORE.get(name, "").format(name=name) + FAULT.format(name=name) * (name in FAULTS)
        node = "rosout" if name == AS_ROSOUT else "controller"
        launch = LAUNCH.format(name=name, node=node, more=more)
        (package / "launch" / "controller.launch").write_text(launch)
        shutil.copy(HERE / (WITH_FAULT if name in FAULTS else name), package / "scripts" / "controller")
        if rviz:
            view = (HERE / "view.rviz").read_text()
            if name == "hides_its_displays":
                for display in ("LaserScan", "Marker"):
                    view = re.sub(rf"(Class: rviz/{display}\n +Enabled: )true", r"\1false", view)
            (package / "rviz" / "view.rviz").write_text(view)
    for script in (package / "scripts").glob("*"):
        script.chmod(0o755)
    return package


if __name__ == "__main__":
    for each in sys.argv[2:] or [*NODES, *FOLDERS, *IN_CPP]:
        make_package(each, sys.argv[1])
