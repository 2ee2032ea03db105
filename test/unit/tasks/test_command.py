"""How a command ends: exit codes that a script can rely on."""

import pytest

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.tasks.command import STOPPED, exit_codes


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (HuskyError("no such file"), 2, "mark: no such file"),
        (OSError(28, "No space left on device"), 2, "No space left"),
        (KeyError("seed"), 2, "mark: this is a bug: KeyError: 'seed'"),
        (KeyboardInterrupt(), STOPPED, "mark: stopped"),
        (SystemExit(1), 1, ""),
    ],
)
def test_only_a_figure_that_is_missed_ends_with_1(error, code, words, capsys):
    with pytest.raises(SystemExit) as end, exit_codes("mark"):
        raise error
    assert end.value.code == code
    assert words in capsys.readouterr().err
