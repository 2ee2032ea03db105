"""Output of a build, of which the student reads one line."""

from pathlib import PurePosixPath

import pytest

from husky_grading.hand_in.build_output import build_error


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("x\nCMake Error at a:1 (find_package):\n  No\n", "CMake Error at a:1 (find_package): No"),
        ("a\n/ws/src/a.cpp:3:1: error: 'x' was not declared\nb", "a.cpp:3:1: 'x' was not declared"),
        ("/ws/src/a.h:3:1: fatal error: no_such/x.h: No such file\n", "a.h:3:1: no_such/x.h: No such file"),
        (
            'Traceback (most recent call last):\n  File "/usr/a.py", line 9, in <module>\n'
            '  File "/ws/src/husky/setup.py", line 3, in <module>\n    import x\nImportError: x\n'
            "CMake Error at /usr/share/catkin/cmake/safe_execute_process.cmake:11 (message):\n",
            "husky/setup.py:3: ImportError: x",
        ),
        ("one\ntwo", "one two"),
        ("", ""),
    ],
)
def test_a_build_that_fails_is_one_line(output, words):
    assert build_error(output, PurePosixPath("/ws")) == words
