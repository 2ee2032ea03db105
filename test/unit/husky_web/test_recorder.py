"""A recorded drive as a page of its own."""

import json
import re

import numpy as np
import pytest

from husky_highlevel_controller.datatypes import HuskyError
from husky_web.recorder import recording_page


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
