"""`./dev new`: its package, and exercise 2's node typed into it, run as docs/exercises.md says."""

import re
import subprocess

import pytest

from husky_highlevel_controller.paths import share_folder

ROOT = share_folder()
DEV = str(ROOT / "dev")
PYTHON_BLOCK = re.compile(r"```python\n(#!.*?)```", re.DOTALL)


def new(folder, *arguments):
    subprocess.run([DEV, "new", "my_husky", *arguments], cwd=folder, check=True)


def test_the_package_drives_and_exercise_2_prints_distances(ros, tmp_path):
    new(tmp_path)
    package = tmp_path / "my_husky"
    _, nearest = PYTHON_BLOCK.findall((ROOT / "docs" / "exercises.md").read_text())
    node = package / "scripts" / "nearest"
    node.write_text(nearest)
    node.chmod(0o755)
    file = package / "test" / "drives.test"
    line = '<node name="nearest" pkg="my_husky" type="nearest" output="screen"/>'
    file.write_text(file.read_text().replace("</launch>", line + "</launch>"))
    # the pillar stands at (20, 5), the lidar 0.34 m ahead of the robot's middle
    assert "smallest distance 20." in ros.rostest(package / "test" / "drives.test", "--text")


@pytest.mark.slow
def test_the_package_in_cpp_is_built_and_drives(ros, tmp_path):
    new(tmp_path, "--cpp")
    workspace = tmp_path / "my_husky_ws"
    built = ros.start(DEV, "run", "catkin_make", "-C", str(workspace))
    assert built.wait() == 0, built.output
    ros.rostest(workspace / "src" / "my_husky" / "test" / "drives.test")
