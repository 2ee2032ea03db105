"""Programs that are forked from a running marking."""

import contextlib
import sys
import threading
import types
from concurrent.futures import ThreadPoolExecutor

from husky_grading.isolation import forked
from husky_grading.isolation.forked import MASTER


def test_programs_may_be_forked_by_several_threads(tmp_path, monkeypatch):
    """Each start hides the script of this program from the child, and shows it again."""
    meeting, script = threading.Barrier(2), sys.modules["__main__"]

    def start():
        with contextlib.suppress(threading.BrokenBarrierError):
            meeting.wait(0.5)  # both are in here, where nothing keeps them apart

    made = types.SimpleNamespace(start=start, pid=1, exitcode=0)
    monkeypatch.setattr(forked, "import_early", lambda: None)
    monkeypatch.setattr(forked, "_CONTEXT", types.SimpleNamespace(Process=lambda **_: made))
    with ThreadPoolExecutor(2) as pool:
        for child in pool.map(lambda _: forked._Child([MASTER], {}, tmp_path), range(2)):
            child.stdout.close()
    assert sys.modules["__main__"] is script
