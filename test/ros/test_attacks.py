"""A class with attacks: none stops it, gets out of the sandbox, earns points, or costs a fellow any."""

import csv
import json
import os
import re
import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path

import psutil
import pytest
import yaml
from packages import FOLDERS, NODES, make_package

from husky_grading.isolation import private_network
from husky_grading.isolation.sandbox import BUBBLEWRAP, kind_of_sandbox

NOBODY = 65534
AS_NOBODY = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
LAUNCH_FILES = ("eval", "itself", "prefix")  # attacks of a launch file
GRADE = ["rosrun", "husky_highlevel_controller", "grade"]
QUICK = ["--trials", "1", "--pace", "8", "--robot", "husky", "--seed", "0"]

# what neither a unit test of the sandbox nor a kept recording shows: all of it at work, and valgrind
STATES = {"drives_by_chance": "to be graded by hand", "hooks_the_setup": "marked"}
HONEST = (
    "complete", "crashes", "commands_zero", "drives_away", "drives_in_cpp", "has_a_wiki_setup",
    "imports_what_is_missing", "marks_in_base_link", "needs_a_missing_package", "raises_in_callback", "rams",
    "spins", "stops_short",
)  # fmt: skip
ATTACKS = (
    "sabotages", "unlinks", "ends_the_master", "eval", "sprays", "forks", "floods_markers", "hides",
    "blocks_readers", "breaks_readers", "forges_events",
)  # fmt: skip


def make_class(folder, *names):
    """Hand-ins by name: of submissions, or of the attacks in the package `attacks`."""
    folder.mkdir(exist_ok=True)
    students = {}
    for name in names:
        if name in NODES + FOLDERS:
            make_package(name, folder)
        else:
            make_package("attacks", folder, name)
            by_argument = {"launch": "attack.launch", "arguments": [f"attack:={name}"]}
            students[name] = {"launch": f"{name}.launch"} if name in LAUNCH_FILES else by_argument
    (folder / "marking.yaml").write_text(yaml.safe_dump({"students": students}))


def tell_places(package, key, folders, port, process):
    """Tell `hooks_the_setup` what to attack: a file, folders, a server, a process."""
    places = {"key": key, "folders": list(folders), "port": port, "pid": process}
    (package / "scripts" / "places.json").write_text(json.dumps(places))


def grade(folder, *arguments, user=(), env=None):
    """Mark a class into `out` beside it; rows of the table by name."""
    command = [*user, *GRADE, "--all", folder, "--out", folder.parent / "out", *QUICK, *arguments]
    done = subprocess.run(list(map(str, command)), env=env, capture_output=True, text=True, check=False)
    assert done.returncode in (1, 2), done.stdout + done.stderr
    with (folder.parent / "out" / "results.csv").open(newline="") as table:
        return {row["submission"]: row for row in csv.DictReader(table)}


def logs_of(out, name):
    """Everything that a hand-in's programs printed, by the place of the log."""
    folder = out / "hand_ins" / name
    return {str(path.relative_to(folder)): path.read_text() for path in folder.glob("**/*.log")}


def assert_without_capabilities(out):
    """Build and node of `hooks_the_setup`; launch files are read before its setup file is there."""
    logs = logs_of(out, "hooks_the_setup")
    for place in ("build.log", "drive_1/submission.log"):
        assert "CapEff:\t0000000000000000\nCapBnd:\t0000000000000000\n" in logs[place], place
        # it may write into a /tmp and a /var/tmp of its own
        assert not re.findall(r"^escaped: (?!write into ).*", logs[place], re.MULTILINE)


def test_no_attack_stops_a_class_or_gets_out_of_it(tmp_path):
    make_class(tmp_path / "class", *STATES)
    out = tmp_path / "out"
    with (tmp_path / "key").open("w") as key, socket.create_server(("127.0.0.1", 0)) as server:
        key.write("secret")
        outside = [Path("/var/tmp"), Path("/usr/local/bin"), tmp_path, out]
        hooks = tmp_path / "class" / "hooks_the_setup"
        tell_places(hooks, key.name, map(str, outside), server.getsockname()[1], os.getpid())
        env = {**os.environ, "FAKE_TOKEN": "secret"}
        rows = grade(tmp_path / "class", "--jobs", "2", "--deadline", "5", env=env)
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()
    assert {name: row["state"] for name, row in rows.items()} == STATES
    assert [rows[name]["total"] for name in STATES] == ["0", "20"]  # for RViz
    if shutil.which("valgrind"):
        chance = (out / "hand_ins" / "drives_by_chance" / "table.txt").read_text()
        assert "`start_` (controller.cpp:36) is read at" in " ".join(chance.split())
    said = logs_of(out, "hooks_the_setup")["drive_1/submission.log"]
    assert "all attempted" in said
    assert "escaped: token" not in said
    if private_network.can_be_made():
        # of each hand-in; the kernel gives the number of one that has ended to the next
        assert os.readlink("/proc/self/ns/net") not in re.findall(r"network: (\S+)", said)
    if kind_of_sandbox() == BUBBLEWRAP:
        assert_without_capabilities(out)
        assert not [path for folder in outside for path in folder.glob("escaped")]
        assert not list(Path("/var/tmp").glob("husky_*"))
    running = [process.info["cmdline"] or [""] for process in psutil.process_iter(["cmdline"])]
    left = [words[0] for words in running if words[0].startswith(f"hook in {tmp_path}")]
    assert not left, "what an environment hook started"


@pytest.fixture
def home():
    """A folder that the user nobody may write; pytest's own are root's alone."""
    if os.getuid() or subprocess.run([*AS_NOBODY, "test", "-r", __file__], check=False).returncode:
        pytest.skip("root marks as another user, who can read the package")
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        yield Path(folder)


def as_nobody(home):
    """Arguments that run a command as the user nobody, to whom `home` is given."""
    subprocess.run(["chown", "-R", f"{NOBODY}:{NOBODY}", str(home)], check=True)
    return [*AS_NOBODY, "env", f"HOME={home}"]


@pytest.mark.slow
@pytest.mark.skipif(kind_of_sandbox() != BUBBLEWRAP, reason="no bubblewrap here")
def test_no_hand_in_of_a_teacher_who_is_not_root_has_a_capability(home):
    make_class(home / "class", "hooks_the_setup")
    tell_places(home / "class" / "hooks_the_setup", "/etc/shadow", ["/usr/local/bin"], 1, os.getpid())
    rows = grade(home / "class", "--deadline", "5", user=as_nobody(home))
    assert rows["hooks_the_setup"]["state"] == STATES["hooks_the_setup"]
    assert_without_capabilities(home / "out")


def points_of(row):
    """Points of each item; -1 for a person."""
    return [float(value or -1.0) for key, value in row.items() if key not in ("submission", "state", "notes")]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Rows of honest hand-ins that are marked one after the other."""
    folder = tmp_path_factory.mktemp("alone")
    make_class(folder / "class", *HONEST)
    return grade(folder / "class", "--deadline", "25")


@pytest.mark.slow
@pytest.mark.parametrize("user", ["root", "nobody"])
def test_in_a_class_with_attacks_the_others_get_what_they_get_alone(user, alone, tmp_path, request, capfd):
    folder = tmp_path if user == "root" else request.getfixturevalue("home")
    make_class(folder / "class", *HONEST, *ATTACKS)
    prefix = () if user == "root" else as_nobody(folder)
    begun = time.monotonic()
    rows = grade(folder / "class", "--deadline", "25", "--jobs", "2", user=prefix)
    with capfd.disabled():
        print(f"\n{len(rows)} hand-ins as {user}: {time.monotonic() - begun:.0f} s")
        for row in rows.values():
            print(*list(row.values())[:9], row["notes"][:100], sep=" | ")
    for name in HONEST:
        # a marker with stamp 0 counts when it comes: 16.2 or 16.3 points
        assert points_of(rows[name]) == pytest.approx(points_of(alone[name]), abs=0.2), name
        assert rows[name]["state"] == alone[name]["state"]
    for name in ATTACKS:
        assert rows[name]["total"] in ("0", ""), name
        if name not in LAUNCH_FILES:
            assert points_of(rows[name])[:2] == [0.0, 0.0], f"{name} drives, and is not left to a person"
