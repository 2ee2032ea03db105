"""Messages of compat/gazebo_msgs have the published fields, so nodes built with Gazebo's talk to ours."""

import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

# MD5 sums of gazebo_msgs 2.9.2 (Noetic), as nodes exchange them
PUBLISHED = {
    "msg.LinkState": "0818ebbf28ce3a08d48ab1eaa7309ebe",
    "msg.LinkStates": "48c080191eb15c41858319b4d8a609c2",
    "msg.ModelState": "9330fd35f2fcd82d457e54bd54e10593",
    "msg.ModelStates": "48c080191eb15c41858319b4d8a609c2",
    "srv.DeleteModel": "9ce56b4e9e54616de25d796dc972a262",
    "srv.GetModelState": "4c515e936d3319c9610c559c60bfc3d4",
    "srv.GetWorldProperties": "36bb0f2eccf4d8be971410c22818ba3f",
    "srv.SetModelState": "5b3ab0281d4f5445def017e3a2e4a07b",
    "srv.SpawnModel": "9ed9c82c96abe1a00c3e8cdaeee24413",
}
COMPAT = Path(__file__).parents[2] / "compat" / "gazebo_msgs"


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_message_has_the_published_md5_sum(name):
    kind, _, message = name.partition(".")
    made = getattr(import_module(f"gazebo_msgs.{kind}"), message)
    assert made._md5sum == PUBLISHED[name]


def test_every_definition_is_compared_and_built():
    files = {f"{path.suffix[1:]}.{path.stem}": path.name for path in COMPAT.glob("*/*.[ms][sr][gv]")}
    assert files.keys() == PUBLISHED.keys()
    listed = (COMPAT / "CMakeLists.txt").read_text()
    assert not [name for name in files.values() if name not in listed]


@pytest.mark.skipif(not shutil.which("cmake"), reason="no CMake here")
def test_a_workspace_that_is_configured_again_builds_them_again(tmp_path):
    command = ["cmake", "-S", str(COMPAT.parents[1]), "-B", str(tmp_path / "build")]
    command += [f"-DCATKIN_DEVEL_PREFIX={tmp_path / 'devel'}", f"-DPYTHON_EXECUTABLE={sys.executable}"]
    # a setup file that is sourced names the workspace itself
    env = {**os.environ, "CMAKE_PREFIX_PATH": str(tmp_path / "devel"), "CMAKE_POLICY_VERSION_MINIMUM": "3.5"}
    for _ in range(2):
        done = subprocess.run(
            [*command, "-DCATKIN_ENABLE_TESTING=OFF"], env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "gazebo_msgs: 4 messages, 5 services" in done.stdout
