"""tools/install.bash with real pips and environments, and an index that the tests make themselves."""

import hashlib
import io
import os
import re
import shutil
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest
from test_dev import ROOT, bash, call

# a build backend in a dozen lines: it "compiles" one object file, and needs nothing of PyPI
BACKEND = """
import os, pathlib, sys, time, zipfile
def build_wheel(folder, config_settings=None, metadata_directory=None):
    print(pathlib.Path("says").read_text(), file=sys.stderr)
    if pathlib.Path("says").read_text():
        sys.exit(1)
    (pathlib.Path(os.environ["TMPDIR"]) / "one.o").touch()
    time.sleep(2)
    name = "pybullet-3.2.7-py3-none-any.whl"
    with zipfile.ZipFile(pathlib.Path(folder) / name, "w") as wheel:
        wheel.writestr("pybullet.py", "made = 'here'")
        info = "pybullet-3.2.7.dist-info"
        wheel.writestr(info + "/METADATA", "Metadata-Version: 2.1\\nName: pybullet\\nVersion: 3.2.7\\n")
        wheel.writestr(info + "/WHEEL", "Wheel-Version: 1.0\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n")
        wheel.writestr(info + "/RECORD", "")
    return name
"""


def offer(path):
    """Put a file, which is still to be written, alone onto its page of the index."""
    path.parent.mkdir(parents=True, exist_ok=True)
    (path.parent / "index.html").write_text(f'<a href="{path.name}">{path.name}</a>')


def wheel(folder, name, version, tag="py3-none-any", **files):
    """A wheel of modules (name: text); its line in a lock file."""
    path = folder / name / f"{name}-{version}-{tag}.whl"
    offer(path)
    info = f"{name}-{version}.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        for module, text in files.items():
            archive.writestr(f"{module}.py", text)
        archive.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        archive.writestr(f"{info}/WHEEL", f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tag}\n")
        archive.writestr(f"{info}/RECORD", "")
    return f"{name}=={version} \\\n    --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"


def source_of_pybullet(folder, says=""):
    """A source archive of PyBullet that fails with a sentence, if one is given; its line in a lock file."""
    path = folder / "pybullet" / "pybullet-3.2.7.tar.gz"
    offer(path)
    files = {
        "PKG-INFO": "Metadata-Version: 2.1\nName: pybullet\nVersion: 3.2.7\n",
        "pyproject.toml": '[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n',
        "backend.py": BACKEND,
        "says": says,
    }
    with tarfile.open(path, "w:gz") as archive:
        for name, text in files.items():
            entry = tarfile.TarInfo(f"pybullet-3.2.7/{name}")
            entry.size = len(text)
            archive.addfile(entry, io.BytesIO(text.encode()))
    return f"pybullet==3.2.7 \\\n    --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"


class Clone:
    """A clone with lock files of its own, and an index that has what they name."""

    def __init__(self, folder, environment):
        self.folder, self.index = folder / "clone", folder / "index"
        (self.folder / "requirements").mkdir(parents=True)
        shutil.copytree(
            ROOT / "tools", self.folder / "tools", ignore=shutil.ignore_patterns("*.py", "benchmarks")
        )
        pybullet = wheel(self.index, "pybullet", "3.2.7", pybullet="made = 'elsewhere'")
        self.lock("launch", pybullet, wheel(self.index, "numpy", "2"))
        self.lock("build")
        copy_environment(environment, self.folder / ".dev" / "venv")

    def lock(self, group, *lines):
        (self.folder / "requirements" / f"{group}.txt").write_text("".join(lines))

    def bash(self, script, clone=None, **env):
        """Run a script with the functions of ./dev in a clone; its output of both kinds and its exit code."""
        begin = f"""cd {clone or self.folder}
            here=$PWD state=$PWD/.dev venv=$PWD/.dev/venv workspace=$PWD/.dev/ws
            mkdir -p $state; source tools/packages.bash; source tools/install.bash
            install_debian_packages() {{ echo "apt: $*"; }}
            """
        inherited = {key: value for key, value in os.environ.items() if not key.startswith("PIP_")}
        where = {
            "PIP_INDEX_URL": self.index.as_uri(),
            "PIP_CONFIG_FILE": os.devnull,
            "HOME": str(self.folder),
        }
        return call("bash", "-eo", "pipefail", "-c", begin + script, env={**inherited, **where, **env})


def copy_environment(old, new):
    """Copy a virtual environment, whose programs name its folder; to make one takes seconds."""
    shutil.copytree(old, new, symlinks=True)
    for path in (new / "bin").glob("pip*"):
        path.write_text(path.read_text().replace(str(old), str(new)))


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("environment") / "venv"
    subprocess.run(["/usr/bin/python3", "-m", "venv", folder], check=True)
    return folder


@pytest.fixture
def clone(tmp_path, environment):
    return Clone(tmp_path, environment)


IMPORTED = "; .dev/venv/bin/python -c 'import pybullet; print(\"pybullet made\", pybullet.made)'"


def test_where_no_wheel_of_pybullet_fits_it_is_compiled_once(clone, environment):
    clone.lock("launch", wheel(clone.index, "numpy", "2"), source_of_pybullet(clone.index))
    output, code = clone.bash(f"sleep() {{ command sleep 0.02; }}; make_venv; complete_venv{IMPORTED}")
    assert code == 0, output
    assert "[dev] compiling PyBullet: 1 of about 290 files\n" in output
    assert re.search(
        r"PyPI has no wheel of PyBullet for Python 3\S+ on \w+, so compiling it once, .* \d+ min",
        output,
    )
    assert "apt: compile\n" in output
    assert "ERROR" not in output
    assert output.endswith("pybullet made here\n")
    assert os.listdir(clone.folder / ".dev" / "wheels") == ["pybullet-3.2.7-py3-none-any.whl"]
    assert not (clone.folder / ".dev" / "compile").exists()
    # a second environment takes the wheel that is there, though the index is gone
    shutil.rmtree(clone.index / "pybullet")
    shutil.rmtree(clone.folder / ".dev" / "venv")
    (clone.folder / ".dev" / "venv-launch.done").unlink()
    copy_environment(environment, clone.folder / ".dev" / "venv")
    output, code = clone.bash(f"make_venv; complete_venv{IMPORTED}")
    assert "compiled" not in output
    assert output.endswith("pybullet made here\n")


def test_where_a_wheel_of_pybullet_fits_nothing_is_compiled(clone):
    output, code = clone.bash(f"make_venv; complete_venv{IMPORTED}")
    assert code == 0, output
    assert "apt:" not in output
    assert output.endswith("pybullet made elsewhere\n")


def test_a_compiler_that_fails_is_quoted(clone):
    says = "examples/pybullet.c:8:10: fatal error: Python.h: No such file or directory"
    clone.lock("launch", source_of_pybullet(clone.index, says))
    output, code = clone.bash("make_venv; complete_venv")
    assert code == 1
    assert says in output
    assert f"pip failed; the whole log is {clone.folder}/.dev/pip.log" in output


def test_a_copied_or_moved_clone_makes_an_environment_of_its_own_once(clone, tmp_path):
    assert clone.bash("make_venv; complete_venv")[1] == 0
    copy = tmp_path / "copy"
    shutil.copytree(clone.folder, copy, symlinks=True)
    pinned = copy / "requirements" / "launch.txt"
    pinned.write_text(pinned.read_text().partition("numpy")[0] + wheel(clone.index, "numpy", "3"))
    output, code = clone.bash("make_venv; complete_venv; .dev/venv/bin/pip list", clone=copy)
    assert code == 0, output
    assert f"this clone was moved or copied to {copy}; making its .dev/venv again" in output
    assert re.search(r"numpy +3", output)
    assert re.search(r"numpy +2", clone.bash(".dev/venv/bin/pip list")[0])
    assert clone.bash("make_venv; complete_venv", clone=copy) == ("", 0)


def test_a_build_that_fails_beside_pip_ends_the_command(clone):
    steps = "make_venv() { :; }; complete_venv() { :; }; build_workspace() { say 'no CMake here'; exit 3; }"
    output, code = clone.bash(f"{steps}; set_up; echo the command runs")
    assert code == 1
    assert "[dev] no CMake here\n" in output
    assert f"the workspace was not built; the whole log is {clone.folder}/.dev/build.log" in output
    assert "the command runs" not in output


def test_the_workspace_is_built_again_if_a_file_changes_that_the_parameters_are_read_from():
    records = re.search(r"RECORDS = \{(.*)\}", (ROOT / "cfg/Controller.cfg").read_text())[1]
    files = re.findall(r'"(\w+\.py)"', records)
    assert len(files) == 2
    for name in files:
        assert f"controller/{name}" in (ROOT / "CMakeLists.txt").read_text()
        assert f"src/*/controller/{name}" in (ROOT / "tools/install.bash").read_text()


def test_the_workspace_of_a_copied_clone_has_no_link_to_the_original(clone, tmp_path):
    (clone.folder / "gone.txt").touch()
    build = (
        "done_before() { :; }; mkdir -p $workspace/devel; touch $workspace/devel/setup.bash; build_workspace"
    )
    clone.bash(build)
    copy = tmp_path / "copy"
    shutil.copytree(clone.folder, copy, symlinks=True)
    (copy / "gone.txt").unlink()
    clone.bash(build, clone=copy)
    links = list((copy / ".dev/ws/src/husky_highlevel_controller").iterdir())
    assert sorted(path.name for path in links) == ["requirements", "tools"]
    assert {Path(os.readlink(path)).parent for path in links} == {copy}


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            "Err:1 Temporary failure resolving 'example.org'",
            "apt-get could not reach its server (Temporary failure",
        ),
        ("E: You don't have enough free space in /var/cache/apt/archives/.", "the disk is full"),
        ("E: Unable to locate package rvix", "E: Unable to locate package rvix"),
        ("2026-11-27T03:01:00,123 ERROR: No such thing\n" + "later\n" * 12, "ERROR: No such thing"),
        ("  a.c:1:10: fatal error: Python.h: No such file\n" + "later\n" * 12, "fatal error: Python.h"),
    ],
)
def test_a_failed_installation_tells_its_cause(lines, words, clone, tmp_path):
    (tmp_path / "apt.log").write_text(lines + "\n")
    output, code = clone.bash(f"die_of_log apt-get {tmp_path}/apt.log")
    assert code == 1
    assert words in output


@pytest.mark.parametrize("sudo", ["", "sudo() { echo asked; return 1; }"])
def test_without_the_right_to_install_an_administrator_is_asked_at_once(sudo):
    users = f"id() {{ echo 1000; }}; missing_packages() {{ echo nano; }}; PATH=; {sudo}\n"
    output, code = bash(
        f"{users} command() {{ [ -n '{sudo}' ] || [ $2 != sudo ]; }}; install_debian_packages run"
    )
    assert code == 1
    assert output.count("asked") == bool(sudo)
    assert "ask an administrator to run: apt-get install --no-install-recommends nano\n" in output


@pytest.mark.parametrize(
    ("change", "is_done"),
    [("", True), ("readlink() { echo /usr/bin/python3.99; }", False), ("opt_ros=/opt/ros/noetic", False)],
)
def test_a_new_python_or_another_ros_is_set_up_anew(change, is_done, tmp_path):
    steps = f"state={tmp_path}\n mark_done venv README.md\n {change}\n done_before venv README.md"
    assert bash(steps)[1] == int(not is_done)


def test_a_log_that_was_never_written_is_no_trouble_of_grep(clone):
    assert clone.bash("die_of_log pip /nowhere/pip.log") == (
        "[dev] error: pip failed before it wrote its log /nowhere/pip.log\n",
        1,
    )


def test_a_dead_proxy_is_called_that_without_its_password(clone):
    clone.lock("launch", source_of_pybullet(clone.index))
    dead = {
        "https_proxy": "http://me:secret@127.0.0.1:9",
        "PIP_INDEX_URL": "https://example.invalid",
        "PIP_RETRIES": "0",
    }
    output, code = clone.bash("make_venv; complete_venv", **dead)
    assert code == 1
    assert "pip could not reach its server through the proxy 127.0.0.1:9 (" in output
    assert "secret" not in output.rpartition("error:")[2]


@pytest.mark.parametrize("settings", [{}, {"ROS_HOME": "{0}/.ros"}])
def test_a_folder_of_logs_that_only_root_may_write_is_named(settings, clone):
    logs = clone.folder / ".ros" / "log"
    logs.parent.mkdir()
    logs.touch()  # root may write into any folder, but not into a file
    env = {
        "ROS_HOME": "",
        "ROS_LOG_DIR": "",
        **{key: value.format(clone.folder) for key, value in settings.items()},
    }
    output, code = clone.bash("need_log_folder", **env)
    assert code == 1
    assert f"cannot write logs to {logs}" in output
    assert "ROS_HOME=" in output
    assert clone.bash("need_log_folder", **{**env, "ROS_LOG_DIR": str(clone.folder)})[1] == 0


ROS2 = {
    "ROS_VERSION": "2",
    "ROS_DISTRO": "humble",
    "AMENT_PREFIX_PATH": "/ws/install/mine:/opt/ros/humble",
    "COLCON_PREFIX_PATH": "/ws/install",
    "CMAKE_PREFIX_PATH": "/opt/ros/humble:/home/me/ws/devel",
    "LD_LIBRARY_PATH": "/opt/ros/humble/lib:/opt/ros/humble/lib/x86_64-linux-gnu",
}


def test_ros_2_is_taken_out_of_the_environment_with_one_line(clone):
    path = f"/opt/ros/humble/bin:/ws/install/mine/bin:{os.environ['PATH']}:/opt/ros/humbler/bin"
    output, code = clone.bash("leave_out_ros2; env", **ROS2, PATH=path)
    assert code == 0
    assert output.count("[dev] this shell has ROS 2 (humble) in its environment; ignoring it\n") == 1
    env = dict(re.findall(r"^(\w+)=(.*)$", output, re.MULTILINE))
    assert {name for name in ROS2 if name in env} == {"CMAKE_PREFIX_PATH"}
    assert env["CMAKE_PREFIX_PATH"] == "/home/me/ws/devel"
    assert env["PATH"] == f"{os.environ['PATH']}:/opt/ros/humbler/bin"


def test_an_environment_without_ros_2_stays(clone):
    output, _ = clone.bash("leave_out_ros2; env", ROS_VERSION="1", CMAKE_PREFIX_PATH="/home/me/ws/devel")
    assert "ignoring" not in output
    assert "CMAKE_PREFIX_PATH=/home/me/ws/devel" in output
