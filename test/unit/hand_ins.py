"""Hand-ins made for tests of marking: packages, launch files and archives, and what marking reads in them."""

import zipfile

from packages import manifest, put

from husky_grading.hand_in import build as build_module
from husky_grading.hand_in import packages as packages_module
from husky_grading.hand_in.archives import Allowance, unpack
from husky_grading.hand_in.copies import copy_packages
from husky_grading.hand_in.packages import open_hand_in
from husky_grading.isolation.sandbox import Workspace
from husky_grading.notes import Kind, Note

NODE = '<node name="n" pkg="{}" type="controller"/>'
RVIZ = '<node name="rviz" pkg="rviz" type="rviz"/>'
WORLD = (
    '<include file="$(find husky_gazebo)/launch/husky_empty_world.launch">'
    '<arg name="world_name" value="$(find {})/worlds/singlePillar.world"/></include>'
)
LARGE = "files larger than 100 MB, or 500 MB together are left out: "


def package(folder, name, *depends, **more):
    put(folder / "package.xml", manifest(name, *depends, **more))
    return folder


def launch(path, *content):
    return put(path, f"<launch>{''.join(content)}</launch>")


def archive(path, files):
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as opened:
        for name, content in files.items():
            opened.writestr(name, content)
    return path


def opened(ann):
    return open_hand_in(ann, ann.parents[1])


def chosen(ann, exercise=3):
    contents = opened(ann)
    packages, notes = packages_module.choose_packages(contents.packages, exercise)
    return contents, packages, [*contents.notes, *notes]


def copied(ann, tmp_path):
    """Folders of the copy that is built, and notes on it."""
    _, packages, _ = chosen(ann)
    return copy_packages(packages, tmp_path / "ws")


def unpacked(path, **allowance):
    """Notes on an archive, and its files, in a folder beside it."""
    to = path.parent / f"{path.name}_unpacked"
    to.mkdir()
    notes = unpack(path, to, Allowance(**allowance))
    return notes, {str(file.relative_to(to)) for file in to.rglob("*") if file.is_file()}


def built(problem):
    return build_module.Build(Workspace(), (Note(Kind.BUILD, problem),) * bool(problem))
