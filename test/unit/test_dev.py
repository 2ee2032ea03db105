"""./dev before it installs anything: what it refuses at once, and the packages it would ask for."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


def call(*command, **how):
    """What a command prints, of both kinds, and its exit code."""
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **how
    )
    return done.stdout, done.returncode


def bash(script, **env):
    """Run a script with the functions of ./dev; its output of both kinds and its exit code."""
    begin = f"cd {ROOT}; here=$PWD state=$PWD/.dev; source tools/packages.bash; source tools/install.bash\n"
    return call("bash", "-eo", "pipefail", "-c", begin + script, env={**os.environ, **env})


def copy_of_dev(folder, *parts):
    """The commands in a folder of their own."""
    folder.mkdir(exist_ok=True)
    shutil.copy(ROOT / "dev", folder)
    for part in ("tools", *parts):
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, folder / part)
        else:
            shutil.copy(ROOT / part, folder)
    return folder / "dev"


TOP = "package.xml CMakeLists.txt setup.py src scripts launch config urdf worlds rviz test"


def test_the_top_level_is_what_the_package_promises():
    assert [name for name in TOP.split() if not (ROOT / name).exists()] == []
    assert (ROOT / "rviz" / "controller.rviz").is_file()
    old = ROOT / "config" / "controller.rviz"  # where launch files of others may still look for it
    assert old.resolve() == (ROOT / "rviz" / "controller.rviz").resolve()


@pytest.mark.parametrize("letter", list(" :;'\"\\$%#&()<>|*?`[]\n"), ids=repr)
def test_a_folder_whose_name_ros_or_cmake_cannot_take_is_refused_at_once(letter, tmp_path):
    copy = tmp_path / f"my{letter}robot"
    output, code = call(copy_of_dev(copy), "launch")
    assert code == 1
    assert f"the folder '{copy}' has a space, a quote or one of " in output
    assert not (copy / ".dev").exists()


@pytest.mark.parametrize("name", ["robot", "a-b_c.d+e,f=g@h~i", "m\u00fcller"])
def test_other_names_of_a_folder_are_taken(name):
    assert bash(f"case {name} in *$odd_letter*) echo refused ;; esac") == ("", 0)


def test_each_example_of_the_help_works():
    text, _ = call(ROOT / "dev", "help")
    examples = re.findall(r"e\.g\. (\./dev .+)", text)
    assert examples == ["./dev test -k timeout", "./dev run rostopic list"]
    ends = {
        "test": ("--collect-only -q", "tests collected"),
        "run": ("", "Unable to communicate with master"),
    }
    env = {**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:1"}
    for example in examples:
        more, said = ends[example.split()[1]]
        assert said in call("bash", "-c", f"{example} {more}", cwd=ROOT, env=env)[0], example


def test_the_workflow_runs_what_ci_runs_on_every_debian_with_ros_and_keeps_the_results():
    (job,) = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"].values()
    supported, _ = bash("echo ${ros_in_archive[*]}")
    assert set(job["strategy"]["matrix"]["debian"]) == {"bookworm", "trixie"} <= set(supported.split())
    assert job["container"]["image"] == "debian:${{ matrix.debian }}"
    (step,) = [step for step in job["steps"] if step.get("run") == ".ci/run"]
    assert os.access(ROOT / step["run"], os.X_OK)
    (upload,) = [step for step in job["steps"] if "upload-artifact" in step.get("uses", "")]
    assert upload["with"]["path"] == f"{step['env']['JUNIT']}/"
    assert '"$JUNIT/core.xml"' in (ROOT / "dev").read_text()


def test_test_files_have_names_of_their_own():
    """Pytest takes two files of one name, in folders that are not packages, for one module."""
    names = [path.name for path in (ROOT / "test").rglob("test_*.py") if "submissions" not in path.parts]
    assert sorted(names) == sorted(set(names))


def test_launching_asks_for_no_packages_of_tests_or_marking():
    output, _ = bash("packages_of launch")
    launch = set(output.split())
    for group in ("rviz", "page", "test", "lint", "grade"):
        others, _ = bash(f"packages_of {group}")
        assert set(others.split()).isdisjoint(launch), group
        assert ("rviz" in others.split()) == (group in ("rviz", "test"))
    assert "python3-rospy" in launch


def function_of_dev(name):
    """The text of one of ./dev's own functions."""
    return next(part for part in (ROOT / "dev").read_text().split("\n\n") if f"{name}() {{" in part)


@pytest.mark.parametrize(
    ("call", "display", "groups"),
    [
        ("groups_of_launch controller.launch real_time_factor:=0", "", ""),
        ("groups_of_launch controller.launch", ":0", "rviz"),
        ("groups_of_launch controller.launch gui:=false", ":0", ""),
        ("groups_of_launch controller.launch gui:=false web:=true", "", "page"),
        ("groups_of_launch web.launch", "", "page"),
        ("groups_of_launch ../my/launch/my.launch", "", "page"),
        ("groups_of_launch my_husky my.launch", "", "page"),
        ("groups_of_command rostopic list", "", ""),
        ("groups_of_command rosrun husky_highlevel_controller evaluate --starts 3", "", "page"),
        ("groups_of_command rosrun husky_highlevel_controller grade --all there", ":0", "rviz grade page"),
        ("groups_of_command python examples/rollout", "", "page"),
        ("groups_of_command pytest -q", "", "test page"),
        ("groups_of_command catkin_make", "", "grade rostest page"),
        ("groups_of_command rostest mine.test", "", "rostest"),
    ],
)
def test_a_command_pulls_in_the_groups_that_it_may_need(call, display, groups):
    output, _ = bash(f"{function_of_dev(call.split()[0])}\n{call}", DISPLAY=display)
    assert output.split() == groups.split()


@pytest.mark.parametrize(("name", "hint"), [("lauch", '; did you mean "launch"?'), ("qqq", "")])
def test_an_unknown_command_is_one_sentence_with_the_nearest_one(name, hint):
    sentence = f"unknown command '{name}'{hint}; ./dev help lists the commands"
    assert call(ROOT / "dev", name) == (f"[dev] error: {sentence}\n", 1)


def test_pip_gets_what_is_locked_for_this_python_only(tmp_path):
    file = tmp_path / "r.txt"
    file.write_text(
        "# by ./dev lock\nold==1 ; python_full_version < '3.8' \\\n    --hash=sha256:1\n"
        "new==2 ; python_full_version >= '3.8' \\\n    --hash=sha256:2\nplain==3 \\\n    --hash=sha256:3\n"
    )
    output, _ = bash(f"venv={sys.prefix}; requirements_here {file}")
    assert re.findall(r"^(\w+)==|sha256:(\d)", output, re.MULTILINE) == [
        ("new", ""), ("", "2"), ("plain", ""), ("", "3")
    ]  # fmt: skip


@pytest.mark.parametrize("group", ["launch", "run", "test", "cluster"])
def test_what_is_depended_on_is_locked_with_hashes_and_names_no_host(group):
    text = (ROOT / "requirements" / f"{group}.txt").read_text()
    entries = re.findall(r"^([\w.-]+)==.*(?:\n .*)*", text, re.MULTILINE)
    blocks = re.findall(r"^\w.*(?:\n .*)*", text, re.MULTILINE)
    assert all("--hash=sha256:" in block for block in blocks)
    wanted = re.findall(r"^(\w[\w-]*)", (ROOT / "requirements" / f"{group}.in").read_text(), re.MULTILINE)
    assert {name.lower().replace("_", "-") for name in wanted} <= {name.lower() for name in entries}
    assert "://" not in text


def test_with_ros_in_opt_nothing_of_ros_is_asked_of_apt():
    output, _ = bash("opt_ros=/opt/ros/noetic; packages_of launch; packages_of test; packages_of lint")
    assert "python3-venv" in output
    assert "ros" not in output.replace("procps", "")
    assert "catkin" not in output


def test_a_system_without_ros_in_its_archive_is_sent_to_the_container():
    output, code = bash(
        "apt-cache() { echo cmake; }; os_name() { echo Ubuntu 24.04; };"
        "state=$(mktemp -d); missing=(cmake rviz); leave_out_absent"
    )
    assert code == 1
    assert "Ubuntu 24.04 has no ROS 1 in its archive; use the container" in output


def test_what_the_archive_of_a_later_debian_has_not_is_named_once_and_left_out(tmp_path):
    output, code = bash(
        "apt-cache() { printf '%s\\n' python3-rospy cmake; }; os_name() { echo Debian forky; };"
        "dpkg-query() { :; }; packages_of() { printf '%s\\n' cmake rviz; };"
        f"state={tmp_path}; missing=(cmake rviz); leave_out_absent; echo to install: ${{missing[*]}};"
        "echo then missing: $(missing_packages launch)"
    )
    assert code == 0
    assert output.count("the archive of Debian forky has no rviz; continuing without") == 1
    assert "to install: cmake\n" in output
    assert "then missing: cmake\n" in output


def test_progress_is_told_every_ten_percent_and_the_rest_is_logged(tmp_path):
    lines = [f"pmstatus:libc6:amd64:{percent}.5:Installing" for percent in range(100)]
    (tmp_path / "in").write_text(
        "\n".join(["Reading package lists...", "dlstatus:1:0.1:Retrieving", *lines]) + "\n"
    )
    output, _ = bash(f"show_progress {tmp_path}/log < {tmp_path}/in")
    assert output.count("installing the packages") == 10
    assert output.count("fetching the packages") == 1
    assert (tmp_path / "log").read_text() == "Reading package lists...\n"


def test_a_folder_of_logs_that_cannot_be_written_is_named_with_the_remedy():
    output, code = bash("need_log_folder", ROS_HOME="/proc/nowhere", ROS_LOG_DIR="")
    assert code == 1
    assert "cannot write logs to /proc/nowhere" in output
    assert "ROS_HOME=" in output


@pytest.mark.parametrize(
    ("uri", "arguments", "port"),
    [
        ("http://localhost:15311", "roscore", "-p 15311"),
        ("http://localhost:15311", "roscore -p 7", ""),
        ("", "roscore", ""),
    ],
)
def test_roscore_listens_where_ros_master_uri_says(uri, arguments, port):
    function = function_of_dev("find_roscore_port")
    output, _ = bash(
        f'{function}\nfind_roscore_port {arguments}; echo "${{roscore_port[*]}}"', ROS_MASTER_URI=uri
    )
    assert output.strip() == port


@pytest.mark.skipif(not (ROOT / ".dev" / "venv-launch.done").exists(), reason="not installed by ./dev")
def test_doctor_finds_what_dev_has_installed():
    output, _ = call(ROOT / "dev", "doctor")
    assert "ok       Python packages in .dev/venv" in output
    assert "ok       the workspace in .dev/ws is built" in output


def test_doctor_names_problems_and_fails_for_them(tmp_path):
    dev = copy_of_dev(tmp_path, "package.xml", "requirements")
    environment = {**os.environ, "ROS_MASTER_URI": "nowhere", "ROS_IP": "", "ROS_HOSTNAME": "no.such.host"}
    output, code = call(dev, "doctor", env=environment)
    assert code == 1
    assert "PROBLEM  ROS_MASTER_URI='nowhere' is not of the form http://HOST:PORT" in output
    assert "PROBLEM  nodes give their address as 'no.such.host'" in output
    assert "PROBLEM  the workspace in .dev/ws is not built; ./dev setup builds it" in output
    assert not (tmp_path / ".dev").exists(), "doctor changes nothing"


def new(folder, *arguments):
    """`./dev new` of a copy of the commands, in that copy; its output and exit code."""
    copy = folder / "clone"
    if not copy.exists():
        copy_of_dev(copy, "examples", "compat")
    return call(copy / "dev", "new", *arguments, cwd=copy)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("", "new needs a package name, e.g. ./dev new my_husky"),
        ("22", "'22' is not a valid ROS package name"),
        ("My", "'My' is not a valid ROS package name"),
        ("../my", "'../my' is not a valid ROS package name"),
        ("husky_gazebo", "ROS already has a package 'husky_gazebo'"),
        ("husky_highlevel_controller", "is the package of the simulator"),
        ("my_husky yours", "new takes one package name but got 'my_husky' and 'yours'"),
        ("my_husky --c", "'--c' is not a valid option of new"),
    ],
)
def test_new_refuses_a_name_that_ros_would_not_take(arguments, words, tmp_path):
    output, code = new(tmp_path, *arguments.split())
    assert code == 1
    assert words in output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clone"]


def test_new_writes_beside_the_clone_and_over_nothing(tmp_path):
    assert new(tmp_path, "my_husky")[1] == 0
    launch = tmp_path / "my_husky" / "launch" / "drive.launch"
    assert 'pkg="my_husky"' in launch.read_text()
    assert os.access(tmp_path / "my_husky" / "scripts" / "drive", os.X_OK)
    launch.write_text("mine")
    output, code = new(tmp_path, "my_husky")
    assert code == 1
    assert "my_husky already exists and is not overwritten" in output
    assert launch.read_text() == "mine"
    assert new(tmp_path, "my_husky", "--cpp")[1] == 0
    package = tmp_path / "my_husky_ws" / "src" / "my_husky"
    assert (package / "src" / "drive.cpp").is_file()
    assert not (package / "scripts").exists()
    assert not [path for path in tmp_path.rglob("my_husky/**/*") if "first_node" in path.name]


def test_new_makes_no_workspace_of_the_home_folder_and_goes_beside_the_clone_behind_a_link(tmp_path):
    source = tmp_path / "src"
    source.mkdir()
    copy_of_dev(source / "clone", "examples", "compat")
    link = tmp_path / "link"
    link.symlink_to(source / "clone")
    env = {**os.environ, "HOME": str(tmp_path)}
    assert call(link / "dev", "new", "my_husky", "--cpp", cwd=link, env=env)[1] == 0
    assert (source / "my_husky_ws" / "src" / "my_husky" / "package.xml").is_file()
    assert not (source / "my_husky").exists()


def test_new_takes_the_name_of_the_course_s_package_with_a_warning(tmp_path):
    output, code = new(tmp_path, "5ro14_husky_controller")
    assert code == 0, output
    assert "warning: the package name '5ro14_husky_controller' begins with a digit" in output
    assert "name its nodes 'ro14_husky_controller...'" in output
    launch = (tmp_path / "5ro14_husky_controller" / "launch" / "drive.launch").read_text()
    assert '<node name="drive" pkg="5ro14_husky_controller"' in launch


@pytest.mark.parametrize("file", ["package.xml", "scripts/drive", "launch/drive.launch"])
def test_exercises_show_what_new_writes(file):
    text = (ROOT / "examples" / "first_node" / file).read_text().replace("first_node", "my_husky")
    kind = "python" if "scripts" in file else "xml"
    assert f"```{kind}\n{text}```" in (ROOT / "docs" / "exercises.md").read_text()


@pytest.mark.parametrize("folder", [".", "examples/first_node", "examples/first_node_cpp"])
def test_cmake_4_takes_what_is_built_here(folder):
    text = (ROOT / folder / "CMakeLists.txt").read_text()
    version = re.match(r"cmake_minimum_required\(VERSION (\d+)\.(\d+)\)", text).groups()
    assert tuple(map(int, version)) >= (3, 5)
