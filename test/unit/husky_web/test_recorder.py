"""A recorded drive as a page of its own."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from page_elements import Element

from husky_highlevel_controller.datatypes import HuskyError, Pose
from husky_web.recorder import RECORD, SAVE, Recorder, recording_page


def test_a_recording_is_a_page_of_the_drive_and_without_a_pillar_too():
    rows = [(0.1 * step, 0.05 * step, 0.0, 0.0, np.nan, np.nan) for step in range(20)]
    seen = [*rows, (2.0, 1.0, 0.0, 0.0, 3.0, 1.0)]
    for rows_of_drive, robot, pillars in ((rows, "another", []), (seen, "smb", [[3.0, 1.0]])):
        page = recording_page(rows_of_drive, robot)
        drive = json.loads(re.search(r'id="data">(.*?)</script>', page).group(1))
        assert drive["pillars"] == pillars
        assert drive["times"][-1] == pytest.approx(rows_of_drive[-1][0])
    with pytest.raises(HuskyError, match="nothing is recorded"):
        recording_page([], "husky")


def test_a_lost_pillar_stays_where_it_was_last_seen():
    xs = [np.nan, 3.0, np.nan, 5.0, np.nan]
    page = recording_page([(0.1 * step, 0.0, 0.0, 0.0, x, 0.0) for step, x in enumerate(xs)], "husky")
    drive = json.loads(re.search(r'id="data">(.*?)</script>', page).group(1))
    assert [x for x, _ in drive["pillars"]] == [3.0, 3.0, 3.0, 5.0, 5.0]


def test_a_recording_ends_when_the_simulator_is_started_again_and_a_late_message_does_not_end_it():
    recorder = Recorder(SimpleNamespace(gui=Element()), None)

    def press(button):
        recorder._on_click(SimpleNamespace(target=SimpleNamespace(value=button), client=None))

    def recorded(times):
        for time in times:
            recorder.tick(time, Pose(), None)
        return [row[0] for row in recorder._rows]

    press(RECORD)
    assert recorded([20.0, 20.1, 20.05, 20.2, 0.1, 0.2, 30.0]) == [20.0, 20.1, 20.2]
    assert recorder._buttons.options == (RECORD, SAVE)
    press(RECORD)  # after the end of the simulator, whose last time is still the newest one
    assert recorded([30.0, 30.0, 0.1, 0.2]) == [0.1, 0.2]
