"""Choice of a submission's launch file by its content: its nodes, its world and its names."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import (
    Any,
    Collection,
    FrozenSet,
    Iterable,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Sequence,
    Set,
    Tuple,
)

from husky_grading.hand_in.copies import Folders
from husky_grading.hand_in.facts import Facts
from husky_grading.hand_in.packages import (
    Contents,
    Fit,
    NotMarkableError,
    Package,
    fit_of_path,
    nodes_in,
    with_dependencies,
)
from husky_grading.hand_in.plan import plans
from husky_grading.isolation.files import (
    UnreadableFileError,
    copy,
    file_suffix,
    is_below,
    texts_in,
    walk,
)
from husky_grading.isolation.sandbox import Workspace
from husky_grading.records import Launchable, Override
from husky_grading.submission import NO_ROBOT_PACKAGES, OWN_RVIZ, Plan, RobotPackages
from husky_highlevel_controller.paths import share_folder

MAX_TEXT_SIZE = 1_000_000  # [bytes] larger source files are not read
# package that `./dev new` copies as a student's first package
TEMPLATE = share_folder() / "examples" / "first_node"
TEMPLATE_CPP = TEMPLATE.with_name("first_node_cpp")
BESIDE = ".beside"  # folder for launch files that are in no package; no package can have this name
MAX_READ = 300  # at most this number of launch files of a submission is read
# launch files with such names are probably not the solution, but tests, old copies, or the solution of
# exercise 4 on localization
OTHER_USE = re.compile(
    r"test|example|demo|tutorial|template|turtle|old|backup|copy|ekf|locali[sz]|slam|mapping|bag",
    re.IGNORECASE,
)
# launch files with such words in their path are probably the solution
CONTROLLER = re.compile(r"high_?level|pillar|controller", re.IGNORECASE)
SCAN = re.compile(r"LaserScan|PointCloud2")  # message types of scans
# message types of scans and velocities; the code of a solution names at least one of them
SCAN_OR_VELOCITY = re.compile(r"LaserScan|PointCloud2|Twist")
SOURCES = {"", ".py", ".cpp", ".cc", ".cxx", ".hpp", ".h"}


class FoundFile(NamedTuple):
    """A launch file that was found in a submission; its content is not read yet."""

    path: Path  # path of the file on this machine
    place: PurePosixPath  # path of the file in the submission


@dataclass(frozen=True)
class LaunchFile:
    """A launch file of a submission, and the nodes that it starts."""

    path: Path  # path of the launch file's copy in the workspace
    place: PurePosixPath  # path of the launch file in the submission
    # package that owns the launch file; if the launch file is in no package, package of the first node that
    # it starts
    package: str
    plan: Plan
    nodes: Tuple[str, ...] = ()  # package/type of each node of the submission that the launch file starts
    scans: bool = False  # true if the code of one of these nodes' packages names the message types of a lidar
    # packages of the submission that may drive the robot, because their code names messages of scans or
    # velocities; the same packages for all launch files of a submission
    driving_packages: FrozenSet[str] = frozenset()
    is_template: bool = False  # true if launch file and node are still as `./dev new` wrote them

    @property
    def driving_nodes(self) -> Tuple[str, ...]:
        """Return the nodes of the launch file whose packages may drive the robot."""
        return tuple(node for node in self.nodes if _package_of(node) in self.driving_packages)


def read_launch_files(
    contents: Contents,
    packages: Sequence[Package],
    own_copies: Folders,
    public_copies: Folders,
    workspace: Workspace,
    override: Override,
    robot_packages: RobotPackages = NO_ROBOT_PACKAGES,
) -> List[LaunchFile]:
    """Find the launch files of a submission, and let roslaunch read which nodes each of them starts.

    Nothing is started. `choose_launch_files` then finds the launch file that solves the exercise.

    Args:
        contents: all packages of the submission.
        packages: packages of which `own_copies` or `public_copies` has a copy.
        own_copies: copies of the student's packages for the exercise.
        public_copies: copies of public packages, whose launch files may start the student's nodes.
        workspace: workspace in which the launch files would be started.
        override: settings of the teacher, which may name one launch file and its arguments.
        robot_packages: packages of ROS whose nodes the exercise uses; without any, the nodes of the student's
            packages belong to the exercise.

    Raises:
        NotMarkableError: no file, or more than one, fits the launch file that the teacher names.
    """
    folders = own_copies.packages
    all_files = _launch_files(contents, packages, {**public_copies.packages, **folders}, own_copies.root)
    files = list(islice(all_files, MAX_READ))
    if override.launch is not None:
        files = [_only_file(files, override.launch)]
    scanning_packages, driving_packages = _packages_by_messages(packages, folders)
    # Package of `own_copies` that contains each launch file. It is empty if the launch file is beside the
    # packages, or in a public package.
    containing_packages = [_package_around(file.path, folders) for file in files]
    # A launchable needs a package. roslaunch gets the path of the file, so it does not use this package. So a
    # launch file outside of the student's packages gets the first one.
    first_package = next(iter(folders), "")
    launchables = [
        Launchable("launch", package or first_package, str(file.path), override.arguments)
        for file, package in zip(files, containing_packages)
    ]
    planned = plans(launchables, workspace, own_copies.root.with_name("plan"), robot_packages)
    # Packages whose nodes show that a launch file is for the exercise. In exercise 4, these are packages of
    # ROS: the filter that the student's launch file starts, and rosbag, which plays the recording. In other
    # exercises, these are the student's packages.
    ros_packages = {*robot_packages.by_submission, *robot_packages.by_marking}
    exercise_packages = ros_packages or set(folders)
    launch_files = []
    for file, package, plan in zip(files, containing_packages, planned):
        nodes = _nodes_of_packages(exercise_packages, file.path, plan)
        launch_file = LaunchFile(
            file.path,
            file.place,
            _owner(package, nodes, folders),
            plan,
            nodes,
            scans=any(_package_of(node) in scanning_packages for node in nodes),
            driving_packages=driving_packages,
            is_template=bool(package) and _is_template(file.path, folders[package], package),
        )
        launch_files.append(launch_file)
    return launch_files


def _package_around(path: Path, folders: Mapping[str, Path]) -> str:
    """Return the name of the package whose folder contains a file; empty if no package contains the file."""
    return next((name for name, folder in folders.items() if folder in path.parents), "")


def _owner(containing_package: str, nodes: Sequence[str], folders: Mapping[str, Path]) -> str:
    """Return the package that owns a launch file; RViz's configuration is searched in this package.

    The owner is the package that contains the launch file. If the launch file is in no package, the owner is
    the package of the first node that is from a package of the student. If there is no such node either, the
    owner is the first package.

    Args:
        containing_package: package that contains the launch file; empty if it is in no package.
        nodes: nodes that the launch file starts, as package/type.
        folders: folders of the student's packages, by the packages' names.
    """
    possible_owners = [containing_package, *map(_package_of, nodes), *folders]
    return next(name for name in possible_owners if name in folders)


def _nodes_of_packages(packages: Collection[str], launch_file: Path, plan: Plan) -> Tuple[str, ...]:
    """Return the nodes of these packages in a launch file, as package/type; `plan` is the launch file's plan.

    The plan leaves out nodes of rosbag, because `grade` plays the recording itself. These nodes count here,
    too. So a launch file of exercise 4 that only plays the recording is still for this exercise.
    """
    if plan.is_read:
        all_nodes: Iterable[str] = (*plan.nodes, *plan.left_out)
    else:  # roslaunch could not read the file, so its text is searched for nodes
        all_nodes = nodes_in(launch_file)
    return tuple(node for node in all_nodes if _package_of(node) in packages)


def _only_file(files: Sequence[FoundFile], end: str) -> FoundFile:
    """Return the launch file that marking.yaml names by its path in the submission, or by the path's end.

    Raises:
        NotMarkableError: there is no such file, or more than one.
    """
    names = PurePosixPath(end).parts  # names of folders and of the file
    fitting = [file for file in files if file.place.parts[-len(names) :] == names]
    if len(fitting) != 1:
        raise NotMarkableError(
            f"marking.yaml names the launch file {end!r}, which fits {len(fitting)} files; "
            "give the path of one file"
        )
    return fitting[0]


def _packages_by_messages(
    packages: Sequence[Package], folders: Mapping[str, Path]
) -> Tuple[Set[str], FrozenSet[str]]:
    """Search sources for message types, and return the packages that read scans, and those that may drive.

    A package reads scans if its own sources name scans. A package may drive the robot if its sources, or
    those of a package of the submission on which it depends, name scans or velocities. A launch file that
    starts nodes of such packages is probably the solution.

    Args:
        packages: packages of the submission.
        folders: folders of the packages whose sources are searched, by the packages' names.
    """
    # texts of the source files that name a message type of scans or velocities, by the name of the package
    texts = {
        name: [text for _, text in texts_in(folder, SOURCES, MAX_TEXT_SIZE) if SCAN_OR_VELOCITY.search(text)]
        for name, folder in folders.items()
    }
    scanning = {name for name in folders if any(map(SCAN.search, texts[name]))}
    searched = {package.name: package for package in packages if package.name in folders}
    driving = set()
    for name in searched:
        names = with_dependencies({name}, searched)  # the package itself, and those on which it depends
        if any(texts[each] for each in names):
            driving.add(name)
    return scanning, frozenset(driving)


def _package_of(node: str) -> str:
    """Return the package of a node, package/type."""
    return node.partition("/")[0]


def choose_launch_files(files: Sequence[LaunchFile], exercise: int, facts: Facts) -> List[LaunchFile]:
    """Return the launch files that start a node that the exercise needs, the most probable solution first.

    If students write a node in this exercise, the node must be from a package that may drive the robot. But
    if the submission has no such package, any node of the submission will do.

    Raises:
        NotMarkableError: no launch file fits.
    """
    fitting = [file for file in files if file.nodes]
    needed_node = facts.node  # description of the node that a fitting launch file starts
    # In exercise 4, students write no node. Their launch file starts a node of a ROS package
    # (`by_submission`), which does not drive.
    students_write_node = not facts.robot_packages.by_submission
    # every launch file has the same `driving_packages`
    driving_packages = files[0].driving_packages if files else frozenset()
    if students_write_node and driving_packages:
        # a node that reads no scans and sends no velocities, as in a tutorial, is not the controller
        fitting = [file for file in fitting if file.driving_nodes]
        needed_node = f"a node of {', '.join(sorted(driving_packages))}"
    if not fitting:
        raise _no_launch_file(files, needed_node)
    # among files with equal merits, the file with the shorter path is better
    return sorted(
        fitting,
        key=lambda file: (*_sort_key(file, exercise, facts), len(file.place.parts), str(file.place)),
    )


def _no_launch_file(files: Sequence[LaunchFile], needed_node: str) -> NotMarkableError:
    """Return the error that no launch file starts a needed node, with the launch files that exist.

    The error also names nodes that are only commented out, because the student may have forgotten them.
    """
    names = ", ".join(sorted(str(file.place) for file in files)[:20]) or "none"
    comments = [
        f"{node} is commented out in {file.place}; "
        for file in files
        for node in nodes_in(file.path, in_comments=True)
    ]
    return NotMarkableError(
        f"no launch file starts {needed_node}; {''.join(comments[:3])}launch files: {names}"
    )


def reasons(launch: LaunchFile, candidates: Sequence[LaunchFile], exercise: int) -> str:
    """Return a sentence for the student with the reasons why this launch file was chosen from candidates."""
    merits = [f"starts {', '.join(launch.nodes)}"]
    if fit_of_path(launch.place, exercise) == Fit.THIS_EXERCISE:
        merits.append(f"has the number of exercise {exercise} in its path")
    if launch.plan.pillar:
        merits.append("uses the world singlePillar")
    # an rviz node with a name of OWN_RVIZ is from a launch file of ours that the student's file includes
    if any(node.name not in OWN_RVIZ for node in launch.plan.rviz):
        merits.append("starts RViz")
    choice = f" (chosen from {len(candidates)})" if len(candidates) > 1 else ""
    return f"launch file {launch.place}: {', '.join(merits)}{choice}"


def _is_template(launch_file: Path, package_folder: Path, package: str) -> bool:
    """Return whether a launch file and its node are still the unchanged example that `./dev new` writes.

    Such a launch file has no work of the student. `./dev new` copies TEMPLATE, adds the files of TEMPLATE_CPP
    for a C++ package, and replaces "first_node" by the name of the student's package, which is `package`. So
    a Python package and a C++ package have the same launch file.
    """

    def is_written_by_us(path: Path, template: Path) -> bool:
        """Return whether a file differs from our example only by the package's name, which replaces ours."""
        if not (template.is_file() and path.is_file() and path.stat().st_size < MAX_TEXT_SIZE):
            return False
        return path.read_bytes() == template.read_bytes().replace(TEMPLATE.name.encode(), package.encode())

    if not is_written_by_us(launch_file, TEMPLATE / "launch" / "drive.launch"):
        return False
    # a package has the Python or the C++ node
    nodes = (TEMPLATE / "scripts" / "drive", TEMPLATE_CPP / "src" / "drive.cpp")
    return any(is_written_by_us(package_folder / node.parent.name / node.name, node) for node in nodes)


def equal_launch_files(
    launch: LaunchFile, candidates: Sequence[LaunchFile], exercise: int, facts: Facts
) -> List[str]:
    """Return the paths of other launch files that fit as well as the chosen one, but start something else.

    If there are any, only the teacher can tell which launch file is the solution.
    """
    best = _sort_key(launch, exercise, facts)
    return [
        str(other.place)
        for other in candidates
        if other.plan.digest != launch.plan.digest and _sort_key(other, exercise, facts) == best
    ]


def _launch_files(
    contents: Contents, packages: Collection[Package], folders: Mapping[str, Path], root: Path
) -> Iterator[FoundFile]:
    """Yield the launch files of packages that were copied, with the path of each file's copy.

    For each package, first come the launch files inside of the package, then those in the folders above the
    package.

    Args:
        contents: all packages of the submission.
        packages: packages that were copied.
        folders: folders of the copies, by the packages' names.
        root: workspace that gets the copies of launch files that are in no package.
    """
    for package in packages:
        copy_folder = folders[package.name]
        for path in walk(copy_folder):
            if file_suffix(path) == ".launch":
                yield FoundFile(path, package.place / path.relative_to(copy_folder).as_posix())
        yield from _copy_launch_files_above(package, contents, root)


def _copy_launch_files_above(package: Package, contents: Contents, root: Path) -> Iterator[FoundFile]:
    """Copy launch files that a student has put beside or above a package, and yield the copies.

    Files that were copied for another package before are left out.
    """
    for path, place in _launch_files_above(package, contents):
        target = root / "src" / BESIDE / place
        if not target.exists():
            with contextlib.suppress(UnreadableFileError):  # `copy` rejects a link or a FIFO
                target.parent.mkdir(parents=True, exist_ok=True)
                copy(path, target)
                yield FoundFile(target, place)


def _launch_files_above(package: Package, contents: Contents) -> Iterator[FoundFile]:
    """Yield the launch files that are in folders around a package, but in no package; inner folders first."""
    # `top` is the submission's folder or an unpacked archive, and `place` is its path in the submission
    for top, place in contents.places.items():
        # only `top` and folders inside of it are searched, because other folders are not the student's
        folders = [folder for folder in package.path.parents if folder == top or top in folder.parents]
        for folder in folders:
            # both .launch and .launch.xml are launch files; `file_suffix` leaves out other names, such as
            # .launch~
            for path in sorted([*folder.glob("*.launch*"), *folder.glob("launch/*.launch*")]):
                is_in_package = any(each.path in path.parents for each in contents.packages)
                # a link could lead out of the submission, to files that are not the student's
                if not is_in_package and is_below(path, top) and file_suffix(path) == ".launch":
                    yield FoundFile(path, place / path.relative_to(top).as_posix())


def _sort_key(file: LaunchFile, exercise: int, facts: Facts) -> Tuple[Any, ...]:
    """Return a key to sort launch files; the launch file with the smallest key is graded.

    Each entry of the key is True if something shows that the launch file is not the student's solution. An
    entry counts only if two launch files are equal in all entries before it.
    """
    fit = fit_of_path(file.place, exercise)
    # a solution starts the course's world and reads scans, and its path often has a word such as controller
    content = (not file.plan.pillar, not file.scans, not CONTROLLER.search(str(file.place)))
    has_no_number = (fit == Fit.NO_NUMBER,)
    # In exercise 3, which sets `by_content`, the world with the pillar is surer evidence than a number in the
    # path, so the content comes first.
    content_and_number = content + has_no_number if facts.by_content else has_no_number + content
    return (
        file.is_template,  # an unchanged template has no work of the student
        fit == Fit.OTHER_EXERCISE,
        _has_other_use(file, facts),  # a launch file for a test is not the solution
        *content_and_number,
        # a word such as controller counts more in the file's name than in a folder's name
        not CONTROLLER.search(file.place.name),
        # the exercises ask for a launch file that starts RViz
        not file.plan.rviz,
    )


def _has_other_use(file: LaunchFile, facts: Facts) -> bool:
    """Return whether a launch file is probably for a test, or an old copy, and not the solution."""
    # packages of ROS whose nodes are graded in place of the student's own nodes; empty except in exercise 4
    graded_packages = facts.robot_packages.by_submission
    if graded_packages:
        # In exercise 4, the name of a solution often has a word of OTHER_USE, such as ekf. So the name does
        # not count, but a launch file without these nodes has another use.
        return not any(_package_of(node) in graded_packages for node in file.nodes)
    return bool(OTHER_USE.search(file.place.name))
