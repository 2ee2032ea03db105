"""Limits of what a hand-in's programs use together."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from husky_grading.isolation import private_network
from husky_grading.isolation.limits import SOCKETS

SOURCES = Path(__file__).parents[4] / "src"
OPENS = """
import os, socket, sys, time
for _ in range(int(sys.argv[1])):
    if os.fork() == 0:
        kept = [socket.socketpair() for _ in range(250)]
        print("opened", flush=True)
        time.sleep(5 if int(sys.argv[1]) == 1 else 1000)
        os._exit(0)
os.wait()
"""
MARKS = """
import os, sys
from pathlib import Path
from husky_grading.isolation import private_network
private_network.enter_network()
from husky_grading.isolation.process import Process, end_all, wait
from husky_grading.isolation.sandbox import Workspace
folder = Path(sys.argv[1])
command = [sys.executable, "-c", sys.argv[2], sys.argv[3]]
process = Process(command, folder / "log", dict(os.environ), folder, Workspace())
wait(lambda: not process.running, 60.0)
end_all([process])
print(process.problem or process.output)
"""


@pytest.mark.skipif(not private_network.can_be_made(), reason="no network namespaces here")
@pytest.mark.parametrize(
    ("processes", "said"),
    [(1, "opened"), (3, f"it was ended: it opened more than {SOCKETS} sockets")],
    ids=["some", "many"],
)
def test_sockets_are_counted_for_whoever_holds_what_the_kernel_keeps_for_them(processes, said, tmp_path):
    (tmp_path / "marks.py").write_text(MARKS)
    (tmp_path / "mine").mkdir()
    env = {**os.environ, "PYTHONPATH": f"{SOURCES}:{os.environ.get('PYTHONPATH', '')}"}
    env.pop(private_network.VARIABLE, None)
    command = [sys.executable, tmp_path / "marks.py", tmp_path / "mine", OPENS, str(processes)]
    done = subprocess.run(command, env=env, stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout.split("\n")[0] == said
