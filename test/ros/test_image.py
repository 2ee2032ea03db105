"""The Dockerfile's steps in a fresh Debian, without Docker: it drives, and the page answers."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path
from urllib.request import urlopen

import pytest
from network import DEADLINE, Process, free_port, wait_until

ROOT = Path(__file__).resolve().parents[2]
INSTALL = "bash tools/install_in_image.sh packages && bash tools/install_in_image.sh build"
PAGE = re.compile(r"http://[^/\s]+:(\d+)(/\?token=\S+)")


@pytest.fixture
def folder():
    made = Path(tempfile.mkdtemp(prefix="husky_image_", dir="/var/tmp"))
    yield made
    # whatever is still mounted there is the machine's own
    if str(made) not in Path("/proc/self/mounts").read_text():
        subprocess.run(["rm", "-rf", "--one-file-system", str(made)], check=True)


@pytest.mark.slow
@pytest.mark.skipif(
    os.getuid() != 0 or shutil.which("debootstrap") is None or not (ROOT / ".git").exists(),
    reason="needs root, debootstrap and a clone",
)
def test_the_image_s_steps_end_in_a_page_that_answers(folder, tmp_path):
    command = (ROOT / "Dockerfile").read_text().splitlines()[-1]
    assert command.startswith("CMD "), command
    start = " ".join(re.findall(r'"([^"]*)"', command))
    start += f" web_port:={free_port()} real_time_factor:=0 -p {free_port()}"
    process = Process(
        [str(ROOT / ".ci" / "chroot"), "bookworm", str(folder), f"{INSTALL} && {start}"],
        tmp_path, dict(os.environ),
    )  # fmt: skip
    try:
        ended = lambda words: words in process.output or process.popen.poll() is not None  # noqa: E731
        wait_until(lambda: ended("arrived after"), "the robot has arrived", deadline=3600.0)
        assert "arrived after" in process.output, process.output[-3000:]
        port, path = PAGE.search(process.output).groups()
        with urlopen(f"http://127.0.0.1:{port}{path}", timeout=DEADLINE) as answer:
            assert b"<html" in answer.read()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.popen.pid, signal.SIGINT)
        process.wait()
