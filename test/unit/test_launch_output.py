"""Output of launched nodes: repeated tracebacks are folded, all else passes; no node without a program."""

import os
import subprocess
import sys
import warnings
from types import SimpleNamespace

import pytest

from husky_highlevel_controller.paths import share_folder

TOOLS = str(share_folder() / "tools")
sys.path.append(TOOLS)

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of rosclean, for distutils
    import launch
    from launch_output import Folder

HEAD = "\x1b[31m[ERROR] [{0}, {0}]: bad callback: <bound method P.cb of <__main__.P object at 0x7f>>\n"
BODY = """Traceback (most recent call last):
  File "/usr/lib/python3/dist-packages/rospy/topics.py", line 750, in _invoke_callback
    cb(msg)
  File "p.py", line 19, in cb
    self.gain * {0}
AttributeError: 'P' object has no attribute 'gain' ({0})
"""


def error(number):
    return (HEAD + BODY.replace("gain * {0}", "gain") + "\x1b[0m\n").format(number)


def folded(text, size, now=lambda: 0.0):
    folder = Folder(now)
    data = text.encode()
    pieces = [folder.feed(data[start : start + size]) for start in range(0, len(data), size)]
    return b"".join([*pieces, folder.close()]).decode()


@pytest.mark.parametrize("size", [1, 7, 10_000_000])
def test_a_traceback_that_comes_again_is_counted(size):
    text = "before\n" + "".join(map(error, range(313))) + "after\n"
    count = "[dev] 312 times more: AttributeError: 'P' object has no attribute 'gain' (#)\n"
    assert folded(text, size) == "before\n" + error(0) + "after\n" + count


def test_the_count_is_told_every_five_seconds():
    clock = iter(range(1000))
    shown = folded("".join(map(error, range(30))), 50, lambda: float(next(clock)))
    assert 3 <= shown.count("times more: AttributeError") <= 30


def test_other_tracebacks_pass_and_a_second_one_in_the_first():
    other = BODY.replace("'gain'", "'speed'").format(1)
    chain = (
        BODY.format(1) + "\nDuring handling of the above exception, another exception occurred:\n\n" + other
    )
    assert folded(chain, 9) == chain
    twice = folded(chain + chain + "after\n", 9)
    assert twice.startswith(chain + "after\n")
    assert twice.count("1 times more") == 2


@pytest.mark.parametrize("size", [1, 7, 10_000_000])
def test_the_header_of_a_refused_connection_is_left_out(size):
    header = {"callerid": "/sim", "topic": "/cmd_vel", "message_definition": "float64 x\n" * 50}
    line = "\x1b[33m[WARN] [1, 2]: {}types differ{}\x1b[0m\n"
    text = "before\n" + line.format("Could not process inbound connection: ", header) + "after\n"
    assert folded(text, size) == f"before\n{line.format('/sim cannot connect to /cmd_vel: ', '')}after\n"


@pytest.mark.parametrize(
    "text",
    [
        "[WARN] [1, 2]: something\n[WARN] [1, 2]: Could not process inbound connection: but otherwise\n",
        "50 %\r100 %\r\nask: ",
        "[ERROR] [1, 2]: something else\n[ERROR] [1, 2]: something else\n",
        "[ERROR] [1, 2]: bad callback: <f>\nanother node's line\n",
        "Traceback (most recent call last):\n  File",
        "\n\n\xff\x1b[1mbold\x1b[0m\n",
        "Traceback (most recent call last):\n" + "  File\n" * 300 + "  File\n" * 300,
    ],
)
@pytest.mark.parametrize("size", [1, 10_000_000])
def test_everything_else_passes(text, size):
    assert folded(text, size) == text


def test_an_unfinished_line_passes_at_once():
    assert Folder().feed(b"password: ") == b"password: "


DIVERT = f"""
import os, subprocess, sys
sys.path.append({TOOLS!r})
from launch_output import FoldedOutput
"""


def test_the_streams_stay_apart_and_whole():
    code = DIVERT + "output = FoldedOutput(); os.write(1, b'one\\n')\n"
    code += "subprocess.run(['sh', '-c', 'echo two; echo err >&2']); output.close(); print('end')"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("one\ntwo\nend\n", "err\n")


def test_nodes_in_a_terminal_are_in_one_still():
    code = DIVERT + "output = FoldedOutput(); ok = os.isatty(1) and os.isatty(2); output.close(); print(ok)"
    master, slave = os.openpty()
    ran = subprocess.run([sys.executable, "-c", code], stdout=slave, stderr=slave, check=True)
    assert ran.returncode == 0
    assert os.read(master, 100) == b"True\r\n"


@pytest.mark.parametrize(
    ("installed", "display", "started"),
    [
        (["rviz", "mine"], ":0", ["rviz", "mine"]),
        (["rviz", "mine"], "", ["mine"]),
        (["mine"], ":0", ["mine"]),
    ],
)
def test_without_rviz_its_nodes_are_left_out_in_one_sentence(
    installed, display, started, monkeypatch, capsys
):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setattr(launch.rospkg, "RosPack", lambda: SimpleNamespace(list=lambda: installed))
    config = SimpleNamespace(nodes=[SimpleNamespace(package=name) for name in ("rviz", "mine")])
    launch.drop_missing_rviz(config)
    assert [node.package for node in config.nodes] == started
    assert ("RViz is not installed" in capsys.readouterr().err) == ("rviz" not in installed)
