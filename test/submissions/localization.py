"""Makes hand-ins of exercise 4, for the SMB: one launch file, and what it names."""

from pathlib import Path

from packages import CMAKE, manifest

LAUNCH = """<launch>
  <param name="use_sim_time" value="true"/>
  <include file="$(find smb_description)/launch/load.launch"/>
  <node name="robot_state_publisher" pkg="robot_state_publisher" type="robot_state_publisher"/>
  {filter}
  {top_view}
  <node name="player" pkg="rosbag" type="play" args="--clock --rate=0.5 $(find {name})/smb_navigation.bag"/>
  <node name="rviz" pkg="rviz" type="rviz" args="-d $(find {name})/cloud.rviz"/>
  <node name="plot" pkg="rqt_multiplot" type="rqt_multiplot" args="--multiplot-run-all"/>
</launch>
"""
FILTER = (
    '<node name="ekf_localization" pkg="robot_localization" type="ekf_localization_node" output="screen">'
    '<rosparam command="load" file="$(find {folder}"/></node>'
)
COURSES = FILTER.format(folder="smb_control)/config/localization.yaml")
OWN = FILTER.format(folder="wrong_topics)/localization.yaml")
TOP_VIEW = (
    '<node name="top_view" pkg="tf2_ros" type="static_transform_publisher" '
    'args="0 0 2 0 0 0 {parent} smb_top_view"/>'
)
ABOVE = TOP_VIEW.format(parent="base_link")
VARIANTS = {  # filter and top view
    "right": (COURSES, ABOVE),
    "no_filter": ("", ABOVE),
    "wrong_topics": (OWN, ABOVE),
    "no_top_view": (COURSES, ""),
    "still_top_view": (COURSES, TOP_VIEW.format(parent="odom")),
    "other_top_view": (COURSES, ABOVE.replace("smb_top_view", "top_view")),
    "no_launch_file": None,
}
YAML = """
frequency: 50
two_d_mode: true
odom_frame: odom
base_link_frame: base_link
world_frame: odom
odom0: /wheels
odom0_config: [no, no, no, no, no, no, yes, yes, no, no, no, yes, no, no, no]
"""
AXIS = "<{side}_axis><topic>/odometry/filtered</topic><field>pose/pose/position/{side}</field></{side}_axis>"
PLOT = f"<rqt_multiplot><axes>{AXIS.format(side='x')}{AXIS.format(side='y')}</axes></rqt_multiplot>"
CLOUD = """
Visualization Manager:
  Global Options: {Fixed Frame: odom}
  Displays:
    - {Class: rviz/PointCloud2, Topic: /rslidar_points, Color Transformer: AxisColor, Axis: Z, Size (m): 0.05}
"""


def make_localization(name, folder):
    """A package of this name in a folder; it needs no build."""
    package = Path(folder) / name
    package.mkdir(parents=True)
    (package / "package.xml").write_text(manifest(name, "catkin", tag="buildtool_depend"))
    (package / "CMakeLists.txt").write_text(CMAKE.format(name=name).replace("catkin_install_python", "# "))
    if VARIANTS[name]:
        filter_node, top_view = VARIANTS[name]
        text = LAUNCH.format(name=name, filter=filter_node, top_view=top_view)
        (package / "exercise_4.launch").write_text(text)
        (package / "cloud.rviz").write_text(CLOUD)
        (package / "plot.xml").write_text(PLOT)
        (package / "localization.yaml").write_text(YAML)
    return package
