"""The page that plays a drive: what it keeps of it."""

import json
import re

import numpy as np

from husky_highlevel_controller.replay import MAX_POSES, Replay, to_html

STANDS = np.array([[20.0, 5.0]])


def content(html):
    (text,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', html)
    return json.loads(text)


def drive(seconds, pillars=STANDS, title="a drive", marks=((1.0, 19.9, 5.1),)):
    times = np.arange(0.0, seconds, 0.005)
    poses = np.column_stack([times, 0.1 * times, 0.01 * times])
    return Replay(title, "it ended", times, poses, pillars, np.array(marks, float).reshape(-1, 3))


def test_start_end_and_way_are_kept():
    data = content(to_html(drive(20.0)))
    assert (data["times"][0], data["times"][-1]) == (0.0, 19.995)
    assert data["poses"][-1] == [19.995, 2.0, 0.2]
    assert 190 <= len(data["times"]) == len(data["poses"]) <= 210
    assert data["pillars"] == STANDS.tolist()
    assert data["marks"] == [[1.0, 19.9, 5.1]]


def test_a_page_stays_small_however_long_the_drive():
    assert len(to_html(drive(20.0))) < 30e3
    assert len(content(to_html(drive(3600.0)))["times"]) <= MAX_POSES + 2


def test_a_pillar_that_is_pushed_moves_with_the_poses():
    replay = drive(2.0)
    pillars = STANDS + np.column_stack([replay.times, replay.times])
    data = content(to_html(drive(2.0, pillars)))
    assert len(data["pillars"]) == len(data["times"])
    assert data["pillars"][-1] == [21.995, 6.995]


def test_marks_without_a_place_are_left_out():
    nan = float("nan")
    assert content(to_html(drive(1.0, marks=((0.5, nan, nan), (0.6, 1.0, 2.0)))))["marks"] == [
        [0.6, 1.0, 2.0]
    ]


def test_a_title_ends_no_script():
    html = to_html(drive(1.0, title="</script><script>alert(1)</script>"))
    assert content(html)["title"] == "</script><script>alert(1)</script>"
    assert html.count("</script>") == 2
