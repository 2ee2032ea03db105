"""Reads of uninitialised variables in valgrind's output: line and variable are named, prints do not count."""

import os

import pytest

from husky_grading.drive import memcheck
from husky_grading.drive.memcheck import (
    is_worth_checking,
    may_be_unwritten,
    reads_in,
    sentence,
)
from husky_grading.records import Launchable
from husky_grading.submission import Submission

SOURCE = """class Controller {
  bool start_;
  double gain_ = 1.0, speed_;
  float x, y;
};
void onScan() {
  if (start_) drive();
  int count;
  if (gain_ > y) drive();
  std::cout << speed_;
}
"""
MADE = "==9==  Uninitialised value was created by a stack allocation\n"
MADE += "==9==    at 0x10A2: main (controller.cpp:30)\n"


def block(first, *frames, made=MADE):
    stack = [f"==9==    {'by' if n else 'at'} 0x4F: {frame}\n" for n, frame in enumerate(frames)]
    return f"==9== {first}\n{''.join(stack)}{made}==9== \n"


JUMP = "Conditional jump or move depends on uninitialised value(s)"
SENT = "Syscall param sendto(msg) points to uninitialised byte(s)"


@pytest.fixture
def sources(tmp_path):
    (tmp_path / "controller.cpp").write_text(SOURCE)
    return tmp_path


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (
            block(JUMP, "onScan() (controller.cpp:7)"),
            "`start_` (controller.cpp:2) is read at controller.cpp:7",
        ),
        (block(JUMP, "onScan() (controller.cpp:9)"), "`y` (controller.cpp:4) is read at controller.cpp:9"),
        (block(JUMP, "std::max(a, b) (stl_algobase.h:254)", "onScan() (controller.cpp:7)"), "`start_` "),
        (block(JUMP, "onScan() (controller.cpp:6)"), "a variable is read at controller.cpp:6 before"),
        (block(JUMP, "vfprintf (vfprintf.c:1)", "onScan() (controller.cpp:10)"), ""),
        (block(JUMP, "std::ostream::_M_insert (ostream.tcc:3)", "onScan() (controller.cpp:10)"), ""),
        (block(JUMP, "boost::thing() (thread.cpp:7)"), ""),
        (
            block(SENT, "send (send.c:28)", "ros::TransportTCP::write (in /usr/lib/libroscpp.so)"),
            "it sends a value that was never written, in an object made at controller.cpp:30",
        ),
        (block(SENT, "send (send.c:28)", "ros::TransportTCP::write (in libroscpp.so)", made=""), ""),
        ("==9== ERROR SUMMARY: 0 errors\n", ""),
    ],
)
def test_a_read_that_decides_is_named(log, said, sources):
    assert sentence(reads_in("==9== Memcheck\n==9== \n" + log, sources), sources).startswith(said)
    assert bool(said) == bool(reads_in(log, sources))


@pytest.mark.parametrize(("name", "is_started"), [("fifo", False), ("program", True), ("none", False)])
def test_only_a_program_is_worth_checking_and_a_fifo_is_not_waited_for(
    name, is_started, tmp_path, monkeypatch
):
    lib = tmp_path / "devel" / "lib"
    lib.mkdir(parents=True)
    os.mkfifo(lib / "fifo")
    (lib / "program").write_bytes(b"\x7fELF...")
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "controller.cpp").write_text(SOURCE)
    monkeypatch.setattr(memcheck.shutil, "which", str)
    submission = Submission(Launchable("node", "a", name), root=tmp_path, nodes=(name,))
    assert is_worth_checking(submission) is is_started


WITH_VALUES = """
#define MANY 3
ros::Publisher velocity;  // bool start_;
double norm(double x, double y) const { return x * y; }
int main(int argc, char** argv) {
  int nearest = -1;
  const double angle = f(argc, argv) * 2.0;
  for (int i = 0; i < 3; ++i) a(i);
  int sum = f(g(1), 2), other(f(g(1), h((2))), 3);
}
"""


def test_valgrind_is_run_where_a_variable_has_no_value():
    without = (
        "bool start_;", "int a = 1, b;", "class A {\n public:\n  float kp;\n};", "float* nearest;",
        "float r[3];", "int* p = new int;", "enum State { A };", "tf::Vector3 v;", "std::array<float, 3> r;",
        "uint8_t k;",
    )  # fmt: skip
    assert [text for text in without if not may_be_unwritten(text)] == []
    assert not may_be_unwritten(WITH_VALUES)
