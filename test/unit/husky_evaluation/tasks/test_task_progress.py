"""Progress of many tasks, as the log of a CI server has it."""

from husky_evaluation.tasks.task_progress import LINE_PERIOD, Progress


def test_without_a_terminal_a_line_comes_every_ten_seconds_and_none_after_the_last_task(capsys):
    now = 0.0
    with Progress(100, "runs", clock=lambda: now) as progress:
        for _ in range(100):
            now += 0.4 * LINE_PERIOD
            progress.update()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "runs: 3 of 100 done, 388 s left"
    assert len(lines) == 33
    assert lines[-1] == "runs: 99 of 100 done, 4 s left"


def test_a_short_command_prints_no_progress(capsys):
    with Progress(2, "runs", clock=lambda: 1.0) as progress:
        progress.update(2)
    assert capsys.readouterr().err == ""
