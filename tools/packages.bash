# The Debian packages that each command of ./dev needs, and the platforms whose archives have them.
# shellcheck shell=bash disable=SC2034  # sourced by ./dev

# the package.xml of a ROS package often sits in its -dev package, and roslaunch needs it
launch_packages=(ca-certificates cmake gcc libc6-dev make python3 python3-venv)  # catkin's cmake needs a C compiler
# robot_state_publisher is for other people's launch files: our simulator sends its frames itself
launch_ros_packages=(
  catkin rosbash rosout ros-robot-state-publisher
  python3-rosbag python3-roslaunch python3-rosmaster python3-rosmsg python3-rosnode python3-rosparam
  python3-rospy python3-rosservice python3-rostopic python3-roswtf python3-tf python3-tf2-ros python3-yaml tf2-tools
  libdynamic-reconfigure-config-init-mutex-dev
  libdiagnostic-msgs-dev libgeometry-msgs-dev libnav-msgs-dev libros-rosgraph-msgs-dev libsensor-msgs-dev
  libstd-msgs-dev libstd-srvs-dev libtf2-msgs-dev libtf2-ros-dev libtopic-tools-dev libvisualization-msgs-dev
  libinteractive-markers-dev python3-dynamic-reconfigure python3-interactive-markers
  ros-message-generation ros-message-runtime
  python3-diagnostic-msgs python3-geometry-msgs python3-nav-msgs python3-rosgraph-msgs python3-sensor-msgs python3-std-msgs
  python3-std-srvs python3-visualization-msgs
  ros-diagnostic-msgs ros-geometry-msgs ros-nav-msgs ros-rosgraph-msgs ros-sensor-msgs ros-std-msgs ros-std-srvs
  ros-visualization-msgs
)
# packages to compile PyBullet, if PyPI has no wheel of it
compile_packages=(g++ python3-dev)
compile_ros_packages=()
# packages for a display
rviz_packages=()
# RViz on Qt 6 draws none of its icons without it, and complains of each
if grep -qx 'VERSION_CODENAME=trixie' /etc/os-release; then rviz_packages+=(qt6-svg-plugins); fi
rviz_ros_packages=(rviz)
# the page in the browser needs PyPI's packages only
page_packages=()
page_ros_packages=()
# `run ... grade` and `run catkin_make`: builds submissions, keeps them in namespaces
grade_packages=(bubblewrap g++ procps util-linux valgrind libc6-dbg)
grade_ros_packages=(
  libroscpp-dev
  # packages that submissions of the courses use
  libactionlib-dev libangles-dev liblaser-geometry-dev libmessage-filters-dev libmove-base-msgs-dev libroslib-dev
  libshape-msgs-dev libtf-conversions-dev libtf-dev libtf2-eigen-dev libtf2-geometry-msgs-dev libtf2-sensor-msgs-dev
  libtrajectory-msgs-dev tf-tools
  python3-actionlib python3-angles python3-laser-geometry python3-message-filters
  python3-tf2-geometry-msgs python3-tf2-sensor-msgs
)
# `run rostest`
rostest_packages=()
rostest_ros_packages=(python3-rostest librostest-dev)
# `test`, which also grades submissions
test_packages=("${grade_packages[@]}" "${rviz_packages[@]}" openbox xvfb)
# Ubuntu has Chromium as a snap only; without it the tests of the page are skipped
if grep -qx 'ID=debian' /etc/os-release; then test_packages+=(chromium-headless-shell fonts-dejavu-core); fi
test_ros_packages=("${grade_ros_packages[@]}" "${rviz_ros_packages[@]}" "${rostest_ros_packages[@]}")
lint_packages=()
lint_ros_packages=(catkin-lint)

# releases whose own archive has all of the above (VERSION_CODENAME or UBUNTU_CODENAME in /etc/os-release)
ros_in_archive=(bookworm trixie focal jammy)
