"""A program that crashes is started once more, one that ends otherwise is not."""

import os
import signal
import subprocess
import sys

import pytest

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros import restart

CRASH_ONCE = """
import os, sys
path = sys.argv[1]
starts = int(open(path).read()) if os.path.exists(path) else 0
open(path, "w").write(str(starts + 1))
if starts < int(sys.argv[2]):
    os.abort()
sys.exit(int(sys.argv[3]))
"""
RESTART = [sys.executable, "-c", "from husky_highlevel_controller.ros.restart import main; main()"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(share_folder() / "src")}


ANNOUNCED = "crashed with SIGABRT; starting it once more"


@pytest.mark.parametrize(
    ("crashes", "code", "end", "starts", "words"),
    [(1, 0, 0, 2, ANNOUNCED), (9, 0, 128 + signal.SIGABRT, 2, ANNOUNCED), (0, 3, 3, 1, "")],
)
def test_a_crash_is_followed_by_one_more_start_that_is_announced(tmp_path, crashes, code, end, starts, words):
    path = tmp_path / "starts"
    command = [*RESTART, sys.executable, "-c", CRASH_ONCE, str(path), str(crashes), str(code)]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=60.0)
    assert (done.returncode, int(path.read_text())) == (end, starts)
    assert words in done.stderr


def test_an_interrupt_reaches_the_program_and_ends_both(tmp_path):
    script = (  # blocked, so that it cannot come just before the wait for it
        "import signal, sys; stop = {signal.SIGINT}; signal.pthread_sigmask(signal.SIG_BLOCK, stop);"
        "print('up', flush=True); signal.sigwait(stop); sys.exit(7)"
    )
    command = [*RESTART, sys.executable, "-c", script]
    process = subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "up\n"
    process.send_signal(signal.SIGINT)
    process.stdout.close()
    assert process.wait(60.0) == 7


def test_an_interrupt_while_the_program_starts_reaches_it(monkeypatch):
    start = subprocess.Popen

    def interrupted(command):
        os.kill(os.getpid(), signal.SIGINT)
        return start(command)

    monkeypatch.setattr(restart.subprocess, "Popen", interrupted)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert restart.run_again_after_crash(["sleep", "60"]) == -signal.SIGINT
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_the_program_opens_a_copy_of_its_configuration_which_lies_beside_its_log(tmp_path):
    ours = tmp_path / "controller.rviz"
    ours.write_text("ours")
    save = "import sys; file = sys.argv[2]; print(open(file).read()); open(file, 'w').write('theirs')"
    command = [sys.executable, "-c", save, "-d", str(ours), f"__log:={tmp_path / 'husky_rviz-3.log'}"]
    done = subprocess.run([*RESTART, *command], env=ENVIRONMENT, capture_output=True, text=True)
    assert (done.stdout, ours.read_text()) == ("ours\n", "ours"), "it is shown, and Ctrl+S does not change it"
    copy = tmp_path / "husky_rviz-3.rviz"
    assert copy.read_text() == "theirs"
    assert f"RViz shows a copy of controller.rviz; Ctrl+S saves to {copy}" in done.stderr


@pytest.mark.parametrize("command", ["rviz", "rviz -d", "rviz -d view.rviz", "rviz -d /no.rviz __log:=/a"])
def test_a_command_without_file_or_log_or_with_a_file_that_is_not_there_stays_as_it_is(command):
    assert restart.with_own_config(command.split()) == command.split()


def test_without_a_display_that_answers_nothing_is_started():
    answer = subprocess.run(
        [*RESTART, "touch", "/dev/null"],
        env={**os.environ, "DISPLAY": ":7654"},
        capture_output=True,
        text=True,
    )
    assert answer.returncode == 1
    assert answer.stderr.strip() == "touch is not started: display :7654 does not answer (no X server)"
