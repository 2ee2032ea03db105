"""Stand-ins for Gazebo's packages: what they take the place of, and the arguments that they accept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from husky_highlevel_controller.paths import share_folder

SCRIPT = share_folder() / "tools" / "gazebo_packages.py"
COMPAT = share_folder() / "compat"
MANIFEST = "<package><name>{}</name><version>0.0.0</version></package>"
LIDAR = "laser_enabled kinect_enabled ur5_enabled"
ARMS = "realsense_enabled dual_ur5_enabled robotiq_grippers_enabled gripper_enabled"
WINDOW = "paused use_sim_time gui headless debug recording physics verbose extra_gazebo_args"
# arguments of the files of husky/husky, husky_simulator, gazebo_ros_pkgs and smb_common, on any branch
ARGUMENTS = {
    "husky_gazebo/empty_world": "world_name",
    "husky_gazebo/husky_empty_world": f"world_name {LIDAR} {ARMS}",
    "husky_gazebo/husky_playpen": f"{LIDAR} {ARMS}",
    "husky_gazebo/playpen": "",
    "husky_gazebo/multi_husky_playpen": LIDAR,
    "husky_gazebo/realsense": "",
    "husky_gazebo/demo_manipulation": f"{LIDAR} gripper_enabled",
    "husky_gazebo/map_empty": "",
    "husky_gazebo/husky_base": "",
    "husky_gazebo/base.urdf.gazebo": "gps_enabled imu_enabled lidar_enabled",
    "husky_gazebo/spawn_husky": f"{LIDAR} {ARMS} robot_namespace x y z yaw urdf_extras joystick multimaster"
    " simulation multimaster_enabled robot_initial_pose husky_gazebo_description ur5_control_yaml_file",
    "husky_description/description": "robot_namespace laser_enabled kinect_enabled realsense_enabled"
    " ur5_enabled urdf_extras",
    "smb_description/load": "description_file description_name wheel_joint_type simulation use_ros_skid_steer"
    " use_ros_control robot_namespace lidar publish_tf control_namespace tracking_camera",
    "smb_gazebo/sim": "description_name robot_namespace control_namespace launch_rviz launch_gazebo_gui lidar"
    " tracking_camera mpc keyboard_teleop world enable_ekf",
    "smb_gazebo/smb_gazebo": "model_path robot_model_name world world_file x y z roll pitch yaw paused debug"
    " use_sim_time verbose publishing_time_step run_gui description_name control_namespace tracking_camera",
    "smb_gazebo/smb_gazebo_empty": "world_name laser_enabled kinect_enabled",
    "husky_control/control": "laser_enabled kinect_enabled config_extras extra_controllers launch_extras"
    " robot_namespace stopped_controllers urdf_extras enable_ekf multimaster multimaster_enabled simulation"
    " realsense_enabled",
    "husky_control/teleop": "joy_dev joystick keyboard",
    "smb_control/control": "robot_description description_file robot_namespace simulation enable_ekf",
    "smb_control/smb_control": "description_name description_file robot_namespace control_namespace"
    " enable_ekf joint_states_topic joystick keyboard_teleop lidar mpc mpc_track_local_plan simulation"
    " tracking_camera",
    "smb_control/teleop": "joy_dev joystick_name_space",
    "gazebo_ros/empty_world": f"{WINDOW} world_name respawn_gazebo use_clock_frequency pub_clock_frequency"
    " output enable_ros_network server_required gui_required",
    "gazebo_ros/elevator_world": f"{WINDOW} world_name output",
    "gazebo_ros/range_world": f"{WINDOW} world output",
    **{f"gazebo_ros/{name}_world": "" for name in ("mud", "rubble", "shapes", "willowgarage")},
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_launch_file_takes_the_arguments_of_every_branch(name):
    package, _, file = name.partition("/")
    launch = ElementTree.parse(COMPAT / package / "launch" / f"{file}.launch").getroot()
    assert launch.tag == "launch"
    assert set(ARGUMENTS[name].split()) <= {arg.get("name") for arg in launch.findall("arg")}


def package(folder: Path, name: str, *files: str) -> Path:
    for file in ("package.xml", *files):
        (folder / name / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / name / file).write_text(MANIFEST.format(name) if file == "package.xml" else file)
    return folder / name


def path_beside(folder: Path) -> "list[Path]":
    """The package path that is printed with a folder's packages on it."""
    env = {**os.environ, "ROS_PACKAGE_PATH": str(folder), "ROS_HOME": str(folder / "home")}
    printed = subprocess.run(
        [sys.executable, str(SCRIPT)], env=env, capture_output=True, text=True, check=True
    )
    return [Path(path) for path in printed.stdout.strip().split(os.pathsep)]


@pytest.mark.parametrize(
    ("name", "replaced"), [("husky_gazebo", "spawn_husky"), ("husky_description", "description")]
)
def test_a_copy_keeps_its_own_files_and_gets_launch_files_that_run_here(tmp_path, name, replaced):
    own = ("worlds/clearpath_playpen.world", "urdf/husky.urdf.xacro", "rviz/view.rviz", "launch/maze.launch")
    copy = package(tmp_path, name, *own, f"launch/{replaced}.launch", "setup.cfg")
    (joined, *others) = path_beside(tmp_path)
    assert tmp_path in others
    assert joined.name == name
    assert [(joined / file).resolve() for file in own] == [copy / file for file in own]
    ours = [*COMPAT.glob(f"{name}/launch/*"), *COMPAT.glob(f"{name}/scripts/*")]
    assert COMPAT / name / "launch" / f"{replaced}.launch" in ours
    for file in ours:
        assert (joined / file.relative_to(COMPAT / name)).resolve() == file.resolve()
    folder = joined.stat().st_ino
    assert path_beside(tmp_path)[0] == joined
    assert joined.stat().st_ino == folder, "another launch may read it"
    assert len(list((tmp_path / "home" / "gazebo_packages").iterdir())) == 1
    shutil.rmtree(joined.parent)
    joined.parent.touch()
    with pytest.raises(subprocess.CalledProcessError):  # a folder that cannot be made is not printed
        path_beside(tmp_path)
    joined.parent.unlink()
    package(tmp_path, name, "worlds/new.world")
    (newer, *_) = path_beside(tmp_path)
    assert (newer / "worlds" / "new.world").resolve() == copy / "worlds" / "new.world"
    shutil.rmtree(copy)
    path_beside(tmp_path)
    assert not list((tmp_path / "home" / "gazebo_packages").iterdir())


WORLD = '<include file="$(find gazebo_ros)/launch/empty_world.launch"><arg name="world_name" value="{}"/>'
SPAWN = '<include file="$(find husky_gazebo)/launch/spawn_husky.launch"/>'
ARG = '<arg name="{}" default="{}"/>'
EDITED_WORLD = WORLD.format("/a.world") + "</include>"
PASSED_WORLD = WORLD.format("$(arg world_name)") + "</include>"


@pytest.mark.parametrize(
    ("files", "kept"),
    [
        ({"smb_gazebo": ARG.format("world_file", "/a.world")}, {"world_file": "/a.world"}),
        ({"spawn_husky": ARG.format("x", "2.0") + ARG.format("joystick", "false")}, {"x": "2.0"}),
        (
            {"spawn_husky": ARG.format("x", "2.0"), "husky_empty_world": EDITED_WORLD + SPAWN},
            {"x": "2.0", "world_name": "/a.world"},
        ),
        ({"husky_empty_world": ARG.format("world_name", "b") + PASSED_WORLD}, {"world_name": "b"}),
        (
            {"husky_empty_world": ARG.format("world_name", "b") + PASSED_WORLD.replace("value", "default")},
            {"world_name": "b"},
        ),
        ({"playpen": EDITED_WORLD}, {"world_name": "/a.world"}),
        ({"husky_playpen": "<a"}, {}),
        (
            {"husky_playpen": '<include file="$(dirname)/husky_playpen.launch"/>' + ARG.format("yaw", "1")},
            {"yaw": "1"},
        ),
        ({"playpen": ARG.format("maze", "b") + WORLD.format("$(eval '/' + maze)") + "</include>"}, {}),
        ({"playpen": WORLD.format("$(eval '/' + 'a')") + "</include>"}, {"world_name": "$(eval '/' + 'a')"}),
        (
            {"spawn_husky": ARG.format("laser_enabled", "false") + ARG.format("kinect_enabled", "true")},
            {"laser_enabled": "false", "kinect_enabled": "true"},
        ),
        ({"spawn_husky": ARG.format("laser_enabled", "$(optenv HUSKY_LMS1XX_ENABLED false)")}, {}),
        ({"spawn_husky": ARG.format("place", "2") + ARG.format("x", "$(arg place)")}, {}),
    ],
)
def test_the_world_and_pose_of_an_edited_launch_file_stay(tmp_path, files, kept):
    *_, name = files
    gazebo = "smb_gazebo" if name == "smb_gazebo" else "husky_gazebo"
    copy = package(tmp_path, gazebo, *(f"launch/{file}.launch" for file in files))
    for file, content in files.items():
        (copy / "launch" / f"{file}.launch").write_text(f"<launch>{content}</launch>")
    (joined, *_) = path_beside(tmp_path)
    ours = ElementTree.parse(COMPAT / gazebo / "launch" / f"{name}.launch").getroot()
    arguments = ElementTree.parse(joined / "launch" / f"{name}.launch").getroot().iter("arg")
    changed = {
        arg.get("name"): arg.get("default") or arg.get("value")
        for arg, before in zip(arguments, ours.iter("arg"))
        if arg.attrib != before.attrib
    }
    assert changed == kept


@pytest.mark.parametrize("encoding", ["shift_jis", "none"])
def test_a_launch_file_in_an_encoding_that_no_parser_knows_costs_nothing_else(encoding, tmp_path):
    copy = package(tmp_path, "husky_gazebo", "launch/playpen.launch")
    (copy / "launch" / "playpen.launch").write_text(f'<?xml version="1.0" encoding="{encoding}"?><launch/>')
    (joined, *_) = path_beside(tmp_path)
    assert (joined / "launch" / "playpen.launch").resolve() == COMPAT / "husky_gazebo/launch/playpen.launch"


@pytest.mark.parametrize("file", sorted(COMPAT.glob("*/launch/*.launch")), ids=lambda file: file.stem)
def test_a_joined_launch_file_names_no_place_outside_of_its_package(file):
    assert "$(dirname)/../.." not in file.read_text() or file.parents[1].name == "gazebo_ros"


def test_xacro_finds_packages_by_the_package_path(tmp_path):
    include = (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="{}"/></robot>'
    )
    package(tmp_path, "their_description")
    (tmp_path / "their_description" / "part.xacro").write_text('<robot><link name="theirs"/></robot>')
    (tmp_path / "r.xacro").write_text(include.format("$(find their_description)/part.xacro"))
    for program in ("xacro", "xacro.py"):  # the second in hand-ins of 2017
        printed = subprocess.run(
            [str(COMPAT / "xacro" / program), str(tmp_path / "r.xacro")],
            env={**os.environ, "ROS_PACKAGE_PATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert '<link name="theirs"/>' in printed.stdout


ACCESSORIES = (
    "flir_blackfly_mount hokuyo_ust10 intel_realsense kinect_camera sensor_arch sick_lms100 sick_lms1xx"
    " sick_lms1xx_mount vlp16_mount"
)
# files of husky/husky, on any branch, that launch and xacro files of other people include
FILES = {
    "husky_control/config/{}.yaml": "cmd_vel_mux control control_flir_ptu control_gripper control_left_ur5"
    " control_right_ur5 control_ur5 empty gazebo_interface imu_filter localization localization_map"
    " localization_odom navsat_transform navsat_transform_sim public_interface teleop"
    " teleop_interactive_markers teleop_logitech teleop_ps4 twist_mux",
    "husky_control/launch/{}.launch": "control teleop",
    "husky_description/launch/{}.launch": "description view_description",
    "husky_description/urdf/{}": "empty.urdf description.xacro",
    "husky_description/urdf/{}.urdf.xacro": "accessories base decorations husky materials pacs parts wheel",
    "husky_description/urdf/accessories/{}.urdf.xacro": f"{ACCESSORIES} gripper velodyne_vlp16_mount",
    "husky_navigation/launch/{}.launch": "amcl amcl_demo exploration exploration_demo gmapping gmapping_demo"
    " hector_slam hector_slam_demo move_base move_base_mapless_demo pointcloud_to_laserscan",
    "husky_viz/launch/{}.launch": "view_diagnostics view_model view_robot",
    "husky_viz/rviz/{}.rviz": "model robot",
}


@pytest.mark.parametrize(
    "file", [pattern.format(name) for pattern, names in FILES.items() for name in names.split()]
)
def test_files_that_people_include_are_there(file):
    path = COMPAT / file
    assert path.is_file()
    if path.suffix == ".yaml":
        assert isinstance(yaml.safe_load(path.read_text()) or {}, dict)
    elif path.suffix != ".rviz":
        ElementTree.parse(path)


OWN_ROBOT = """<robot name="husky" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="$(find husky_description)/urdf/decorations.urdf.xacro"/>
  <xacro:include filename="$(find husky_description)/urdf/wheel.urdf.xacro"/>
  {}
  <link name="base_link"/><xacro:husky_decorate/>
  <xacro:husky_wheel wheel_prefix="front_left"><origin xyz="0.256 0.2854 0.03282"/></xacro:husky_wheel>
  <xacro:sick_lms1xx_mount prefix="front" topic="front/scan"/>
  <xacro:hokuyo_ust10_mount prefix="rear" topic="rear/scan" parent_link="base_link"><origin/>
  </xacro:hokuyo_ust10_mount>
  <xacro:sensor_arch prefix="" parent="top_plate_link" size="300"><origin xyz="-0.3 0 0"/></xacro:sensor_arch>
  <xacro:intel_realsense_mount prefix="camera" topic="realsense" parent_link="sensor_arch_mount_link"/>
  <xacro:vlp16_mount prefix="" parent_link="top_plate_link" topic="points"><origin/></xacro:vlp16_mount>
  <xacro:kinect_camera prefix="kinect" robot_namespace="/"/>
  <joint name="j" type="fixed"><parent link="top_plate_link"/><child link="front_laser_mount"/></joint>
  <joint name="k" type="fixed"><parent link="base_link"/><child link="kinect_link"/></joint>
</robot>"""


def test_a_description_of_ones_own_expands_into_the_frames_that_it_asks_for(tmp_path):
    line = '<xacro:include filename="$(find husky_description)/urdf/accessories/{}.urdf.xacro"/>'
    own = tmp_path / "own.urdf.xacro"
    own.write_text(OWN_ROBOT.format("".join(map(line.format, ACCESSORIES.split()))))
    printed = subprocess.run(
        [str(COMPAT / "xacro" / "xacro"), str(own)],
        env={**os.environ, "ROS_PACKAGE_PATH": str(COMPAT)},
        capture_output=True,
        text=True,
        check=True,
    )
    root = ElementTree.fromstring(printed.stdout)
    links = {link.get("name") for link in root.iter("link")}
    children = {child.get("link") for child in root.iter("child")}
    assert links - children == {"base_link"}
    assert {"front_laser", "rear_laser", "sensor_arch_mount_link", "front_left_wheel_link"} <= links


@pytest.mark.parametrize(
    ("there", "added", "kept"),
    [
        (["pointcloud_to_laserscan"], ["husky_gazebo"], ["pointcloud_to_laserscan"]),
        (["husky_gazebo", "gazebo_ros"], [], ["husky_gazebo", "gazebo_ros"]),  # a real Gazebo
    ],
)
def test_only_what_is_missing_is_added(there, added, kept, tmp_path):
    for name in there:
        package(tmp_path, name, "launch/spawn_husky.launch")
    path = path_beside(tmp_path)
    assert path[0] == tmp_path
    assert {COMPAT / name for name in added} <= set(path)
    assert not {COMPAT / name for name in kept} & set(path)


@pytest.mark.parametrize(("place", "prefix"), [("a", "a/.dev/ws/devel"), ("a/b", "devel"), ("a/b", ".")])
def test_the_simulators_workspace_is_found_where_a_hand_in_hides_it(place, prefix, tmp_path):
    script = "compat/husky_gazebo/scripts/in_simulator_workspace"
    (tmp_path / place / script).parent.mkdir(parents=True)
    shutil.copy(share_folder() / script, tmp_path / place / script)
    (tmp_path / prefix).mkdir(parents=True, exist_ok=True)
    (tmp_path / prefix / "setup.bash").write_text("export SOURCED=here")
    command = [str(tmp_path / place / script), "printenv", "SOURCED"]
    env = {**os.environ, "ROS_PACKAGE_PATH": ""}
    assert subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout == "here\n"
