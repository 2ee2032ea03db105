"""`./dev launch`: arguments are checked before anything starts, and a failed drive is a failed command."""

import re
import shutil
import signal
import subprocess
import sys

import pytest
from network import LAUNCH, PACKAGE, make_package, wait_until
from test_rviz import Screen

from husky_grading.hand_in.plan import plan
from husky_grading.isolation.own_files import VisibleCode
from husky_grading.isolation.sandbox import Workspace
from husky_grading.records import Launchable
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.node import LAUNCH_FILES

ROOT = share_folder()
SIMULATOR = "$(find husky_highlevel_controller)/launch/simulator.launch"


@pytest.mark.parametrize(
    ("file", "content", "argument", "words"),
    [
        (
            "controller.launch",
            "",
            "wrold_name:=empty.world",
            "controller.launch has no argument 'wrold_name'; did you mean 'world_name'?",
        ),
        ("controller.launch", "", "gui=false", "'gui=false' is not a valid argument. Write gui:=false"),
        (
            "controler.launch",
            "",
            "",
            "cannot find the launch file 'controler.launch'; this package has controller.launch",
        ),
        (
            "theirs.launch",
            '<arg name="speed" default="1"/>',
            "spede:=2",
            "theirs.launch has no argument 'spede'; did you mean 'speed'? It takes: speed",
        ),
        (
            "robot.launch",
            f'<include file="{SIMULATOR}" pass_all_args="true"/>',
            "naive:=true",  # which only the controller takes
            "robot.launch has no argument 'naive'",
        ),
        ("web.launch", "", "real_time_factor:=6", "web.launch has no argument 'real_time_factor'"),
        (
            "talker.launch",
            '<node name="a" pkg="rostopic" type="rostopic"/>',
            "seed:=6",  # which only a file takes that starts the simulator
            "talker.launch has no argument 'seed'. It takes: none",
        ),
    ],
)
def test_a_mistake_on_the_command_line_is_refused_in_a_line(file, content, argument, words, launch, tmp_path):
    (tmp_path / file).write_text(f"<launch>{content}</launch>")
    launched = launch(tmp_path / file if content else file, argument)
    assert launched.wait() == 1
    *_, line = launched.output.splitlines()
    assert line.startswith(f"[dev] error: {words}")
    assert "process[" not in launched.output, "nothing has started"


def test_an_argument_for_an_include_that_takes_all_is_none_of_them(launch, tmp_path):
    (tmp_path / "inner.launch").write_text(
        '<launch><arg name="speed"/><param name="speed" value="$(arg speed)"/></launch>'
    )
    outer = tmp_path / "outer.launch"
    outer.write_text('<launch><include file="$(dirname)/inner.launch" pass_all_args="true"/></launch>')
    launch(outer, "speed:=2", "--screen").says("* /speed: 2")


def test_a_launch_file_that_is_not_well_formed_is_named(launch, tmp_path):
    file = tmp_path / "bad.launch"
    file.write_text('<launch><node name="a" pkg="rospy" type="x"></launch>')
    launched = launch(file)
    assert launched.wait() == 1
    assert f"while processing {file}:\nInvalid roslaunch XML syntax: mismatched tag" in launched.output


@pytest.mark.parametrize(
    ("argument", "content", "words"),
    [
        (
            "world_name:=nowhere.world",
            None,
            "error: husky_simulator: no world 'nowhere.world'; there are driveThrough.world, empty.world",
        ),
        ("", "p_gain_vle: 1.0\n", "error: husky_highlevel_controller: .*p_gain_vle"),
        ("", "p_gain_vel: 1.0\np_gain_ang: [\n", "mine.yaml:3: not valid YAML: "),
        ("", "1.0", "mine.yaml must have lines 'parameter: value'"),
        (
            "robot:=smb kinect_enabled:=true",
            None,
            "kinect_enabled = True, but robot_description has no 'camera_frame_optical'",
        ),
        (
            "laser_enabled:=false lockstep:=true",
            None,
            "lockstep = True, but the robot has no lidar, and lockstep waits for answers to its scans",
        ),
        (
            "seed:=3000000000",
            None,
            "/husky_simulator/seed = 3000000000 does not fit into the 32 bits of a parameter",
        ),
        (f"seed:={10**400}", None, r"/husky_simulator/seed = 10{19}\.\.\. \(401 digits\) does not fit into "),
        (
            "parameters:=mine.yaml",
            None,
            r"cannot read parameters:=mine.yaml in .*: No such file or directory. Check the path",
        ),
    ],
)
def test_what_ends_a_launch_is_its_last_line(argument, content, words, launch, tmp_path):
    (tmp_path / "mine.yaml").write_text(content or "")
    argument = argument or f"parameters:={tmp_path / 'mine.yaml'}"
    launched = launch("controller.launch", "gui:=false", *argument.split())
    assert launched.wait() == 1
    assert re.search(words, launched.output.splitlines()[-1]), launched.output
    assert "Traceback" not in launched.output


def test_a_display_that_does_not_answer_is_one_sentence(launch):
    launched = launch("controller.launch", "real_time_factor:=0", "exit_on_arrival:=true", DISPLAY=":7654")
    assert launched.wait() == 0
    assert "arrived after" in launched.output
    assert "warning: display :7654 does not answer" in launched.output
    assert "husky_rviz" not in launched.output


OWN_RVIZ = """<launch>
  <include file="$(find husky_highlevel_controller)/launch/simulator.launch"/>
  <node name="rviz" pkg="rviz" type="rviz"/>
</launch>"""


def test_a_launch_file_with_an_rviz_of_its_own_opens_that_one(launch, ros, tmp_path):
    file = tmp_path / "package" / "own_rviz.launch"
    file.parent.mkdir()
    file.write_text(OWN_RVIZ)
    display = Screen(ros).display
    plain = subprocess.run(
        ["roslaunch", "--nodes", str(file)],
        capture_output=True,
        text=True,
        env={**ros.env, "DISPLAY": display},
    )
    assert plain.stdout.split() == ["/husky_simulator", "/husky_rviz", "/rviz"], plain.stderr
    launched = launch(file, DISPLAY=display)
    launched.says("process[rviz-")
    assert "husky_rviz" not in launched.output
    workspace = Workspace(packages=(file.parent,), own=VisibleCode.NOTHING)
    marked = plan(Launchable("launch", PACKAGE, str(file)), workspace, tmp_path / "plan")
    assert [node.name for node in marked.rviz] == ["rviz"]


@pytest.mark.parametrize(("words", "code"), [("nonsense", 1), ("list", 0)])
def test_a_launch_ends_as_its_required_node_does_also_in_a_namespace(words, code, launch, tmp_path):
    file = tmp_path / "namespace.launch"
    node = f'<node name="short" pkg="rostopic" type="rostopic" args="{words}" required="true"/>'
    file.write_text(f'<launch><group ns="robot1">{node}</group></launch>')
    launched = launch(file)
    assert launched.wait() == code, launched.output


def test_a_terminal_that_cannot_open_is_left_away(launch, tmp_path):
    file = tmp_path / "terminal.launch"
    node = (
        '<node name="{0}" pkg="rostopic" type="rostopic" args="list" output="screen" launch-prefix="{0} -e"/>'
    )
    file.write_text(f"<launch>{node.format('xterm')}{node.format('noterm')}</launch>")
    launched = launch(file)
    for node in ("xterm-2", "noterm-3"):
        launched.says(f"[{node}] process has finished cleanly")
    assert (
        "node noterm starts without launch-prefix 'noterm -e' because noterm is not installed"
        in launched.output
    )
    assert "node xterm starts without launch-prefix 'xterm -e'" in launched.output


def test_a_drive_without_arrival_ends_with_1_at_the_deadline(launch):
    # in lockstep: else scans come late on a busy machine, which is told in place of what the robot does
    pace = ("real_time_factor:=0", "lockstep:=true")
    launched = launch("controller.launch", "gui:=false", *pace, "exit_on_arrival:=true", "deadline:=5")
    assert launched.wait() == 1
    reason = "no arrival within 5 s of simulated time; last: "
    # until the controller's first status has come, odometry says what the robot does
    lasts = ("driving", "the robot moves", "no odometry has come")
    sentences = [f"[dev] error: arrival_exit: {reason}{last}" for last in lasts]
    assert launched.output.splitlines()[-1] in sentences


def test_a_drive_that_is_stopped_on_its_way_ends_with_1(launch, ros):
    launched = launch("controller.launch", "gui:=false", "exit_on_arrival:=true")
    launched.says("driving to the pillar")
    ros.call("/husky_highlevel_controller/start_stop", "false")
    launched.says("stopped on its way")
    assert launched.wait() == 1


@pytest.mark.parametrize(
    ("program", "words"),
    [("nosuch", "cannot find the command 'nosuch' in "), ("{}/node.py", "'{}/node.py' is not executable")],
)
def test_a_program_that_is_not_there_is_one_sentence(program, words, ros, tmp_path):
    (tmp_path / "node.py").write_text("import rospy\n")
    ran = ros.start(str(ROOT / "dev"), "run", program.format(tmp_path))
    assert ran.wait() == 1
    assert ran.output.startswith(f"[dev] error: {words.format(tmp_path)}")
    assert ran.output.count("\n") == 1


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        (
            "http://no-such-host.invalid:11311",
            "the host 'no-such-host.invalid' of ROS_MASTER_URI has no address on this machine",
        ),
        (
            "http://192.0.2.1:11311",
            "no ROS master answers at http://192.0.2.1:11311. Start roscore on '192.0.2.1'",
        ),
        ("localhost", "ROS_MASTER_URI='localhost' is not of the form http://HOST:PORT"),
    ],
)
def test_a_master_that_cannot_be_reached_is_one_sentence(uri, words, launch):
    launched = launch("controller.launch", "gui:=false", ROS_MASTER_URI=uri)
    assert launched.wait() == 1
    assert words in launched.output
    assert launched.output.count("\n") == 1


FAULTY = """#!/usr/bin/env python3
import traceback
for _ in range(313):
    try:
        None.nothing
    except AttributeError:
        traceback.print_exc()
"""


def test_an_own_launch_file_s_simulator_takes_arguments_and_repeated_tracebacks_are_counted(
    launch, ros, tmp_path
):
    node = '<node name="faulty" pkg="mine" type="faulty"/>'
    text = f'<launch><include file="{SIMULATOR}"><arg name="gui" value="true"/></include>{node}</launch>'
    package = make_package(tmp_path / "src" / "mine", "mine", {"scripts/faulty": FAULTY, "mine.launch": text})
    wrong = launch(package / "mine.launch", "guy:=false")
    assert wrong.wait() == 1
    assert "mine.launch has no argument 'guy'; did you mean 'gui'?" in wrong.output
    launched = launch(package / "mine.launch", "gui:=false", "x:=3.5")
    launched.says("312 times more: AttributeError: 'NoneType' object has no attribute 'nothing'")
    assert launched.output.count("Traceback") == 1
    assert ros.master("getParam", "/husky_simulator/x") == 3.5


SLIPS = """#!/usr/bin/env python3
import rospy
from geometry_msgs.msg import TwistStamped
rospy.init_node("drive")
speed = rospy.get_param("~speed", 0.0)
publisher = rospy.Publisher("/cmd_vel", TwistStamped, queue_size=1)
while not rospy.is_shutdown():
    publisher.publish(TwistStamped())
    rospy.sleep(0.1)
"""


def test_slips_of_a_parameter_a_type_and_a_dependency_are_a_sentence_each(launch, ros, tmp_path):
    node = '<node name="drive" pkg="mine" type="drive" output="screen"><param name="sped" value="1"/></node>'
    text = f'<launch><include file="{SIMULATOR}" pass_all_args="true"/>{node}</launch>'
    package = make_package(tmp_path / "src" / "mine", "mine", {"scripts/drive": SLIPS, "mine.launch": text})
    manifest = package / "package.xml"
    manifest.write_text(manifest.read_text().replace("</package>", "<depend>rosspy</depend></package>"))
    launched = launch(package / "mine.launch", "gui:=false")
    launched.says("depends on 'rosspy', which is not a package here: did you mean 'rospy'?")
    launched.says("/husky_simulator cannot connect to /cmd_vel: topic types do not match")
    launched.says("asked for the parameter /drive/speed, which is not set, but /drive/sped is set")
    launched.says("/drive publishes geometry_msgs/TwistStamped on /cmd_vel, but /husky_simulator reads")
    assert "message_definition" not in launched.output


def test_nodes_of_this_package_and_tools_have_no_slips(launch, ros, tmp_path):
    launched = launch("controller.launch", "gui:=false", "web:=true", "real_time_factor:=2")
    launched.says("simulating")
    ros.roslaunch("proximity_stop.launch")
    ros.start("rosbag", "record", "-a", "-O", str(tmp_path / "all.bag"))
    ros.start("rosparam", "get", "/")
    launched.says("arrived after")
    for words in ("asked for the parameter", "which no node", "no message arrives", "zero commands"):
        assert words not in launched.output
    assert ros.master("getUnreadParams") == []


def master_answers(ros):
    try:
        return ros.master("getPid") > 0
    except OSError:
        return False


def test_a_node_without_parameters_names_its_launch_file(ros):
    ros.start("rosmaster", "--core", "-p", str(ros.port))
    wait_until(lambda: master_answers(ros), "there is a master")
    executables = {"husky_highlevel_controller": "husky_controller", "husky_simulator": "husky_simulator"}
    started = {node: ros.start("rosrun", PACKAGE, program) for node, program in executables.items()}
    for node, file in LAUNCH_FILES.items():
        assert f'name="{node}"' in (ROOT / "launch" / f"{file}.launch").read_text()
    for node, ran in started.items():
        assert ran.wait() == 1
        assert " is missing" in ran.output
        assert f"; start it by roslaunch {PACKAGE} {LAUNCH_FILES[node]}.launch" in ran.output
    naive = ros.start("rosrun", PACKAGE, "naive_controller")
    wait_until(lambda: "/front/scan" in ros.subscriptions("/naive_controller"), "it runs with its defaults")
    assert naive.popen.poll() is None


STUDENTS_TEST = """<launch>
  <include file="$(find husky_highlevel_controller)/launch/simulator.launch">
    <arg name="world_name" value="$(find course_worlds)/pillar.world"/>"""


def test_rostest_finds_the_package_of_its_file_and_those_of_the_caller(ros, tmp_path):
    package = tmp_path / "src" / "my_husky"
    shutil.copytree(ROOT / "examples" / "ci", package)
    world = (ROOT / "worlds" / "singlePillar.world").read_text()
    worlds = make_package(tmp_path / "elsewhere" / "course_worlds", "course_worlds", {"pillar.world": world})
    test = package / "test" / "reaches_the_pillar.test"
    head, _, rest = test.read_text().partition("""simulator.launch">\n""")
    test.write_text(STUDENTS_TEST + rest)
    assert head
    ros.rostest(test, ROS_PACKAGE_PATH=str(worlds.parent))


INTERRUPTED = """
import os, runpy, signal, sys

left = int(sys.argv.pop(1))

def interrupt():
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGTERM)

os.register_at_fork(after_in_parent=interrupt)
sys.argv.pop(0)
sys.path[0] = os.path.dirname(sys.argv[0])
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize("which", range(1, 5))  # master, rosout, simulator, controller
def test_a_signal_while_a_process_is_being_forked_ends_everything(which, ros, tmp_path):
    arguments = ("controller.launch", "gui:=false", "-p", str(ros.port))
    (tmp_path / "tmp").mkdir()
    command = (sys.executable, "-c", INTERRUPTED, str(which), LAUNCH, *arguments)
    launched = ros.start(*command, TMPDIR=str(tmp_path / "tmp"))
    assert launched.wait() == 128 + signal.SIGINT
    assert "Traceback" not in launched.output
    assert ros.left() == []
    assert list((tmp_path / "tmp").iterdir()) == []
