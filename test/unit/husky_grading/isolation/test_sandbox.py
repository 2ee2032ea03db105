"""Untrusted programs: what they may see, write and use up, and that none of them is left."""

import ast
import os
import secrets
import signal
import socket
import subprocess
import sys
import types
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import psutil
import pytest

from husky_grading.isolation import limits, ros_network, sandbox
from husky_grading.isolation.files import (
    remove_tree,
)
from husky_grading.isolation.process import LOG_HEAD, LOG_TAIL, Process, end_all, wait
from husky_grading.isolation.sandbox import Workspace, kind_of_sandbox
from husky_highlevel_controller.datatypes import HuskyError

SOURCES = Path(__file__).parents[4] / "src"
KINDS = BUBBLEWRAP, NAMESPACE, NONE = sandbox.BUBBLEWRAP, sandbox.NAMESPACE, sandbox.NONE  # the best first
OWN = secrets.token_hex(8)  # in the names of processes, so that no other test run finds them
WITH_SOURCES = {**os.environ, "PYTHONPATH": f"{SOURCES}:{os.environ.get('PYTHONPATH', '')}"}


def run(folder, code, workspace=None, **env):
    """Start Python code as an untrusted program that may write its folder only."""
    folder.mkdir(exist_ok=True)
    command = [sys.executable, "-c", code]
    return Process(command, folder / "log", {**os.environ, **env}, folder, workspace or Workspace())


def output_of(process, seconds=60.0):
    try:
        assert wait(lambda: not process.running, seconds), process.output
    finally:
        end_all([process])
    return process.output


def told(*words):
    """What a Python program of this package prints."""
    command = [sys.executable, *words]
    return subprocess.run(
        command, env=WITH_SOURCES, stdout=subprocess.PIPE, text=True, check=True
    ).stdout.splitlines()


def ended(process, problem):
    """End a process that marking ended for a problem."""
    try:
        assert wait(lambda: not process.running, 60.0), process.output
        assert process.problem.startswith(f"it was ended: {problem}")
    finally:
        end_all([process])


def setup_file(folder, text="export FOUND=1"):
    """The setup.bash of a workspace."""
    file = folder / "devel" / "setup.bash"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    return file


def named(name):
    """Processes that call themselves so."""
    running = psutil.process_iter(["cmdline"])
    return [process for process in running if (process.info["cmdline"] or [""])[0] == name]


def is_made(kind):
    """Whether this machine can make a kind of sandbox."""
    if KINDS.index(kind) < KINDS.index(kind_of_sandbox()):
        return False
    return kind != NAMESPACE or sandbox.works("unshare", *sandbox._NAMESPACE, "true")


@pytest.fixture(params=KINDS)
def kind(request, monkeypatch):
    """Each kind of sandbox that this machine can make."""
    if not is_made(request.param):
        pytest.skip(f"this machine does not make a {request.param}")
    monkeypatch.setattr(sandbox, "kind_of_sandbox", lambda: request.param)
    return request.param


def test_a_slow_machine_gets_no_weaker_sandbox(monkeypatch):
    monkeypatch.setattr(sandbox, "PROBE_DEADLINE", 0.1)
    with pytest.raises(HuskyError, match=r"sleep has not answered within 0\.1 s"):
        sandbox.works("sleep", "20")
    assert not sandbox.works("false")
    assert not sandbox.works("no_such_program")


def test_output_without_end_fills_no_disk(tmp_path):
    process = run(tmp_path, "for i in range(600000): print('0123456789')\nprint('the end')")
    assert output_of(process).endswith("the end\n")
    assert len(process.output) <= LOG_HEAD + LOG_TAIL + 1
    assert (tmp_path / "log").read_bytes().endswith(b"the end\n")
    assert (tmp_path / "log").stat().st_size < LOG_HEAD + LOG_TAIL + 100


FACTS = """
import os, resource, sys
print([sys.stdin.read()], resource.getrlimit(resource.RLIMIT_NOFILE))
print(max(int(p) for p in os.listdir("/proc") if p.isdigit()) < 10)
"""


def test_it_gets_no_input_1024_descriptors_and_sees_no_process_but_its_own(kind, tmp_path):
    keyboard, mine = os.pipe()[0], os.dup(0)
    os.dup2(keyboard, 0)  # no input comes on it, so a program that reads it waits for ever
    try:
        assert output_of(run(tmp_path, FACTS)) == f"[''] (1024, 1024)\n{kind != NONE}\n"
    finally:
        os.dup2(mine, 0)


HIDDEN = """
import os, signal, time
for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(each, signal.SIG_IGN)
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.execve("/usr/bin/sleep", ["{name}", "1000"], {{}})
    os._exit(0)
{last}
"""


@pytest.mark.parametrize("last", ["time.sleep(1000)", "raise SystemExit(3)"], ids=["is ended", "ends itself"])
def test_no_process_is_left_that_hides(last, kind, tmp_path):
    """The hidden one has no parent, no session and no environment of ours."""
    name = f"hidden_{OWN}_{kind.replace(' ', '_')}_{last[:5]}"
    process = run(tmp_path, HIDDEN.format(name=name, last=last))
    if last == "time.sleep(1000)":
        assert wait(lambda: named(name), 30.0)
        assert end_all([process]) == []
    else:
        assert wait(lambda: not process.running, 30.0)
        assert process.popen.returncode == 3
    assert not named(name)


MARKING = """
import os, sys
from pathlib import Path
from husky_grading.isolation import sandbox
from husky_grading.isolation.forked import MASTER, ForkedProcess
from husky_grading.isolation.process import Process, Workspace

print("begun", flush=True)
folder, name, kinds = Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
command, env = ["bash", "-c", f"exec -a {name} sleep 1000"], dict(os.environ)
started = [Process(command, folder / "log", env, folder, None)]
for kind in kinds:
    sandbox.kind_of_sandbox = lambda: kind
    started.append(Process(command, folder / kind, env, folder, Workspace()))
started.append(ForkedProcess([MASTER, "--core", "-p", "0"], folder / "master", env, folder))
print(started[-1].popen.pid, flush=True)
sys.stdin.read()
"""


def test_all_end_when_marking_is_killed_and_run_no_script_of_it_again(tmp_path):
    """As the kernel does it when memory runs out: no handler of marking runs."""
    script, name, kinds = tmp_path / "script", f"orphan_{OWN}", list(filter(is_made, KINDS))
    script.write_text(MARKING)
    command = [sys.executable, script, tmp_path, name, *kinds]
    env = {**WITH_SOURCES, "TMPDIR": str(tmp_path)}  # what is killed leaves its temporary files
    marking = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env, text=True)
    try:
        begun, master = marking.stdout.readline(), int(marking.stdout.readline())
        assert wait(lambda: len(named(name)) == 1 + len(kinds), 30.0)
    finally:
        marking.kill()
        printed, _ = marking.communicate(timeout=60)
    assert (begun, printed) == ("begun\n", ""), "once"
    assert wait(lambda: not named(name) and not psutil.pid_exists(master), 30.0)


needs_bubblewrap = pytest.mark.skipif(kind_of_sandbox() != BUBBLEWRAP, reason="no bubblewrap here")
TRY = """
from pathlib import Path
for path, content in {}:
    try:
        print(Path(path).write_text(content) if content else Path(path).read_text())
    except OSError as error:
        print(error.strerror)
"""


@needs_bubblewrap
def test_it_reads_and_writes_nothing_of_others_and_finds_its_workspace_also_by_a_link(tmp_path):
    home, mine, others = (tmp_path / name for name in ("home", "mine", "others"))
    setup = setup_file(tmp_path / "data" / "ws")
    (tmp_path / "link").symlink_to(tmp_path / "data")
    linked = tmp_path / "link" / "ws" / "devel"
    for path in (home / ".ssh" / "id", others / "answer"):
        path.parent.mkdir(parents=True)
        path.write_text("secret")
    reads = (home / ".ssh" / "id", others / "answer", linked / "setup.bash")
    writes = (others / "new", setup, SOURCES / "new", "/etc/new", mine / "new")
    tries = [*((str(path), "") for path in reads), *((str(path), "x") for path in writes)]
    code = TRY.format(tries) + "import os; print(os.environ['FOUND'])"
    process = run(mine, code, Workspace((setup,), (), (others,)), HOME=str(home), LD_LIBRARY_PATH=str(linked))
    absent, read_only = "No such file or directory", "Read-only file system"
    assert output_of(process).splitlines() == [absent, absent, "export FOUND=1", *[read_only] * 4, "1", "1"]
    assert not (others / "new").exists()
    assert (mine / "new").read_text() == "x"


LOOK = """
import os, pathlib
print(sorted(os.listdir("/")))
paths = pathlib.Path("/etc").rglob("*")
secrets = [path for path in paths if not path.lstat().st_mode & 4 and path.is_file()]
print(list(map(str, secrets)))
mounts = [line.split() for line in open("/proc/self/mountinfo")]
kinds = [(words[4], words[5].split(","), words[words.index("-") + 1]) for words in mounts]
others = ("proc", "devpts", "mqueue")
writable = [place for place, options, kind in kinds if "rw" in options and kind not in others]
print(sorted(filter(os.path.isdir, writable)))
"""


def test_a_file_that_vanishes_meanwhile_does_not_uncover_the_secrets_beside_it(tmp_path, monkeypatch):
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text("")
        (tmp_path / name).chmod(0o600)
    scandir = os.scandir

    @contextmanager
    def scandir_late(folder):
        """Each first entry is deleted after the folder was listed."""
        with scandir(folder) as entries:
            listed = list(entries)
            Path(listed[0].path).unlink()
            yield listed

    monkeypatch.setattr(sandbox.os, "scandir", scandir_late)
    assert len(sandbox._secrets(str(tmp_path))) == 2


@needs_bubblewrap
def test_it_sees_no_secret_and_no_other_folder_of_the_machine_and_can_write_only_where_it_is_counted(
    tmp_path,
):
    mine = tmp_path / "mine"
    for folder in (mine / "home", tmp_path / "out"):
        folder.mkdir(parents=True)
    process = run(mine, LOOK, Workspace(hidden=(tmp_path / "out",)), HOME=str(mine / "home"))
    folders, secrets, writable = map(ast.literal_eval, output_of(process).splitlines())
    needed = {tmp_path.parts[1], SOURCES.parts[1]}  # what it runs in, and this package
    assert set(folders) <= {*sandbox.SYSTEM, "dev", "proc", "tmp", "var", "root", *needed}
    assert secrets == []
    assert writable == sorted([*limits.TEMPORARY, str(mine)])


def test_a_setup_file_runs_inside_and_changes_nothing_outside(kind, tmp_path):
    """Such as an env hook of catkin: its search path does not find marking's own programs."""
    setup = setup_file(tmp_path, f"export PATH={tmp_path}:$PATH LD_PRELOAD=/no/such.so HOOK=$$\n")
    (tmp_path / "unshare").write_text("#!/bin/bash\necho evil\n")
    (tmp_path / "unshare").chmod(0o755)
    code = "import os; print(os.environ['HOOK'])"
    lines = output_of(run(tmp_path / "run", code, Workspace((setup,)))).splitlines()
    assert "evil" not in lines
    assert kind == NONE or int(lines[-1]) < 10, "its process id is one of the sandbox"
    assert "HOOK" not in os.environ


@pytest.mark.skipif(
    subprocess.run(["unshare", "--user", "--map-root-user", "--net", "true"], capture_output=True).returncode
    != 0,
    reason="no network namespaces here",
)
def test_the_private_network_has_a_loopback_and_no_way_out(tmp_path):
    code = (
        "import socket, sys\n"
        "from husky_grading.isolation import private_network\nprivate_network.enter_network()\n"
        "print(private_network.reach())\nserver = socket.create_server(('127.0.0.1', 0))\n"
        "socket.create_connection(server.getsockname()).close()\n"
        "for address in ('192.0.2.1', 80), ('127.0.0.1', int(sys.argv[1])):\n"
        "    try:\n        socket.create_connection(address, 5)\n"
        "    except OSError as error:\n        print(error.strerror)\n"
    )
    (tmp_path / "inside.py").write_text(code)
    with socket.create_server(("127.0.0.1", 0)) as outside:
        lines = told(tmp_path / "inside.py", str(outside.getsockname()[1]))
    assert lines == ["loopback only", "Network is unreachable", "Connection refused"]


# ---------------------------------------------------------------------------- what it may use up

DEEP = """
for _ in range(3000):
    os.mkdir("d")
    os.chdir("d")
"""
UNLINKED = """
kept = []
for n in range(10):
    kept.append(open(str(n), "wb"))
    os.unlink(str(n))
    kept[-1].write(bytes(10_000_000))
    kept[-1].flush()
"""
SHARED = """
import mmap
kept = [mmap.mmap(-1, 20_000_000) for _ in range(20)]
for each in kept:
    each.write(b"x" * 20_000_000)
"""
IN_MEMORY = """
for folder in ("/tmp", "/dev/shm", "/var/tmp"):
    open(folder + "/a", "wb").write(bytes(80_000_000))
"""
MEMORY_PROBLEM = "it used more than 0.2 GB of memory"
DISK_PROBLEM = "it wrote more than 0.05 GB of files"


def misuse(code, problem, folder, monkeypatch):
    """Run a program that uses up more than it may; it is ended for this problem, and its files can go."""
    monkeypatch.setattr(limits, "MEMORY", 200_000_000)
    monkeypatch.setattr(limits, "DISK", 50_000_000)
    monkeypatch.setattr(limits, "FILES", 5000)
    ended(run(folder, f"import os, time\n{code}\ntime.sleep(1000)"), problem)
    remove_tree(folder)
    assert not folder.exists()


def test_memory_that_is_shared_counts_too(kind, tmp_path, monkeypatch):
    misuse(SHARED, MEMORY_PROBLEM, tmp_path / "mine", monkeypatch)


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("for n in range(10): open(str(n), 'wb').write(bytes(10_000_000))", DISK_PROBLEM),
        (DEEP, "its size cannot be watched: File name too long"),
        (UNLINKED, DISK_PROBLEM),
        ("for n in range(6000): os.mkdir(str(n))", "it made more than 5000 files and folders"),
        pytest.param(IN_MEMORY, MEMORY_PROBLEM, marks=needs_bubblewrap),
    ],
    ids=["together", "deep", "unlinked", "many", "in memory"],
)
def test_no_trick_keeps_files_from_being_counted(code, problem, tmp_path, monkeypatch):
    misuse(code, problem, tmp_path / "mine", monkeypatch)


SEGMENTS = """
import ctypes, time
libc = ctypes.CDLL(None)
libc.shmat.restype = ctypes.c_void_p
libc.shmdt.argtypes = [ctypes.c_void_p]
for _ in range(3):
    place = libc.shmat(libc.shmget(0, 80_000_000, 0o1600), None, 0)
    ctypes.memset(place, 1, 80_000_000)
    libc.shmdt(place)
print("detached", flush=True)
time.sleep(1000)
"""


@needs_bubblewrap
def test_shared_memory_that_nothing_is_attached_to_counts_too(tmp_path, monkeypatch):
    process = run(tmp_path, SEGMENTS)
    try:
        assert wait(lambda: "detached" in process.output, 60.0)
        with ThreadPoolExecutor(1) as watch:  # as often as it is asked
            processes = limits.processes_below(process.popen.pid)
            sizes = [watch.submit(limits.detached_segments, processes).result() for _ in range(3)]
        assert min(sizes) >= 240_000_000
        monkeypatch.setattr(limits, "MEMORY", 200_000_000)
    finally:
        ended(process, MEMORY_PROBLEM)


SLEEPERS = """
import os, time
for _ in range(1500):
    if os.fork() == 0:
        os.execv("/bin/sleep", ["NAME", "100"])
time.sleep(100)
"""
THREADS = """
import threading, time
threading.stack_size(65536)
for _ in range(1500):
    threading.Thread(target=time.sleep, args=(100,), daemon=True).start()
time.sleep(100)
"""


@pytest.mark.parametrize(
    "code",
    [pytest.param(SLEEPERS, id="processes"), pytest.param(THREADS, id="threads", marks=pytest.mark.slow)],
)
def test_processes_and_threads_are_limited_where_uid_0_marks_too(kind, code, tmp_path):
    name = f"sleeper_{OWN}"
    process = run(tmp_path, code.replace("NAME", name))
    try:
        assert wait(lambda: not process.running, 60.0)
        if not os.getuid():  # the kernel refuses them to other users
            assert process.problem == "it was ended: it started more than 1000 processes and threads"
    finally:
        end_all([process])
    assert not named(name)


def test_the_marking_program_has_limits_of_its_own():
    code = (
        "import resource\nfrom husky_grading import mark, records\n"
        "kinds = resource.RLIMIT_DATA, resource.RLIMIT_NOFILE\n"
        "mark.load = lambda *_: records.Job('', '', records.MarkingConfig())\n"
        "mark.private_network.enter_network = lambda: None\n"
        "mark.mark = lambda _: print(*[resource.getrlimit(kind)[0] for kind in kinds])\n"
        "mark.main(['job.json'])"
    )
    assert told("-c", code)[-1] == "2000000000 1024"


def test_nothing_of_the_teachers_environment_but_what_ros_needs(tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_TOKEN", "secret")
    assert "FAKE_TOKEN" not in sandbox.clean_environment()
    network = types.SimpleNamespace(folder=tmp_path, processes=[], variables=dict)
    network.folder_of = partial(ros_network.Network.folder_of, network)
    process = ros_network.Network.start(network, "submission", ["env"], Workspace())
    names = {line.partition("=")[0] for line in output_of(process).splitlines()}
    assert names >= {"PATH", "USER"}  # a launch file names $(env USER)
    assert names <= {
        *sandbox.KEPT_VARIABLES, "USER", "HOME", "ROS_HOME", "ROS_LOG_DIR", "PWD", "OLDPWD", "SHLVL", "_",
        "LD_PRELOAD", "_STDBUF_O",  # of stdbuf
    }  # fmt: skip


def test_a_log_replaces_a_link_instead_of_writing_through_it(tmp_path):
    (tmp_path / "bashrc").write_text("mine")
    (tmp_path / "log").symlink_to(tmp_path / "bashrc")
    assert output_of(Process(["echo", "evil"], tmp_path / "log", dict(os.environ), tmp_path)) == "evil\n"
    assert (tmp_path / "bashrc").read_text() == "mine"
    assert (tmp_path / "log").read_text() == "evil\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_end_every_wait(number):
    code = (
        "from husky_grading.isolation import process\n"
        "process.stop_on_signals()\nprint('up', flush=True)\nprocess.wait(lambda: False, 1000.0)"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    marking = subprocess.Popen([sys.executable, "-c", code], env=WITH_SOURCES, text=True, **pipes)
    assert marking.stdout.readline() == "up\n"
    marking.send_signal(number)
    _, error = marking.communicate(timeout=60)
    assert "marking was interrupted" in error


def test_a_folder_that_is_named_twice_in_a_row_is_hidden_too():
    script, env = SOURCES.parent / "tools" / "in_workspace.bash", {**os.environ, "PYTHONPATH": "/a:/a:/b"}
    command = ["bash", script, "", "/a", "--", "printenv", "PYTHONPATH"]
    shown = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    assert shown.stdout == "/b\n"
