"""The teacher's page and a student's feedback: sorted, self-contained, harmless."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from husky_grading.notes import Kind
from husky_grading.records import Item, MarkingResult
from husky_grading.reports.files import replays
from husky_grading.reports.page import class_page, feedback_page, histogram
from husky_highlevel_controller.drawing.replay import Replay, to_html

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
PNG = b"\x89PNG\r\n\x1a\n"
SETTINGS = {"exercise": 3, "seed": 0}


def result(name, points, open_points=0.0, **more):
    items = (
        Item("drives", points, 50.0, "half of the way <b>after</b> 10.20 s", 10.2),
        Item("RViz", None if open_points else 20.0, 20.0, "by hand"),
    )
    return MarkingResult(name, "controller.launch", SETTINGS, more.pop("items", items), **more)


CLASS = [
    result("Zoe", 50.0),
    result("anna", 25.0, open_points=20.0),
    result("Bob", 0.0, items=(), problem="it does not build: no 'foo.h'"),
]


def test_the_class_is_sorted_and_each_has_points_sum_state_and_logs():
    page = class_page(CLASS, {}, {"anna": [("build log", 'anna/ws/"><script>.log')]})
    names = re.findall(r'<a href="#s\d+">([^<]+)</a>', page)
    assert names == ["anna", "Bob", "Zoe"]
    assert "open / 20" in page
    assert "70 / 70" in page  # Zoe's sum
    assert "could not be marked: it does not build: no &#39;foo.h&#39;" in page
    for state in ("marked", "to be graded by hand", "could not be marked"):
        assert f"<b>1</b><span>{state}</span>" in page
    assert '<a href="anna/ws/%22%3E%3Cscript%3E.log">build log</a>' in page


def test_the_headline_is_what_is_decided_and_another_robot_is_coloured():
    robots = {"robot": "auto", "simulated": "husky"}, {"robot": "auto", "simulated": "husky_melodic"}
    anna = result("anna", 25.0, open_points=20.0)
    husky, melodic = (
        replace(anna, name=robot["simulated"], settings={**SETTINGS, **robot}) for robot in robots
    )
    page = class_page([husky, melodic], {}, {})
    assert "<b>100 of 140</b><span>decided points</span>" in page
    assert '<td class="">husky</td>' in page
    assert '<td class="person">husky_melodic</td>' in page
    nothing = class_page([replace(husky, items=(Item("style", None, 30.0, "by hand"),))], {}, {})
    assert 'full">0 / 0' not in nothing


def test_with_the_smb_s_class_no_row_is_coloured_for_its_robot():
    of_class = [
        replace(result(name, 50.0), settings={**SETTINGS, "robot": "auto", "simulated": robot})
        for name, robot in (("a", "smb"), ("b", "husky"), ("c", "smb"))
    ]
    page = class_page(of_class, {}, {})
    assert page.count('<td class="">smb</td>') == 2
    assert '<td class="person">husky</td>' in page


def test_a_row_that_could_not_be_marked_says_why_and_the_histogram_has_a_unit():
    page = class_page(CLASS, {}, {})
    assert '<td colspan="3">it does not build: no &#39;foo.h&#39;</td>' in page
    assert "submissions by % of their decided points" in page


def test_the_headline_tells_how_many_wait_only_for_want_of_an_rviz_file():
    lacks = Item("RViz", None, 20.0, "by hand", reason=Kind.NO_RVIZ_FILE)
    by_hand = Item("style", None, 30.0, "by hand")
    of_class = [result("a", 0.0, items=(lacks,)), result("b", 0.0, items=(lacks, by_hand)), result("c", 50.0)]
    assert "1 of 3 submissions wait only because no RViz" in class_page(of_class, {}, {})
    assert "wait only because" not in class_page(CLASS, {}, {})


def test_an_option_in_a_hint_is_not_broken_after_its_hyphen():
    item = Item("RViz", 0.0, 20.0, "none", hint="name it by -d <x>, not by left-handed")
    page = feedback_page(result("a", 0.0, items=(item,)), [])
    assert '<span class="unbroken">-d</span> &lt;x&gt;, not by left-handed' in page


def test_the_median_and_the_histogram_are_of_those_that_were_marked():
    open_only = result("Eve", 0.0, items=(Item("RViz", None, 20.0, "by hand"),))
    page = class_page([*CLASS, open_only], {}, {})
    assert "<b>75 %</b><span>median of the decided points</span>" in page  # 70 of 70, 25 of 50
    assert all("median" not in class_page(results, {}, {}) for results in ([], [CLASS[2]]))
    bars = histogram([1.0, 0.5, 0.0])
    assert {bar["label"]: bar["count"] for bar in bars if bar["count"]} == {"0-9": 1, "50-59": 1, "100": 1}
    assert max(bar["height"] for bar in bars) == 60
    assert histogram([0.7])[7]["count"] == 1, "a border counts in the higher bar"


def test_what_a_submission_wrote_is_text():
    evil = result("<script>alert(1)</script>", 1.0, notes=("<img src=x onerror=alert(1)>",))
    for page in (class_page([evil], {evil.name: [PNG]}, {}), feedback_page(evil, [PNG])):
        assert "<script" not in page
        assert "<img src=x" not in page
        assert "<b>after</b>" not in page
        assert page.count("data:image/png;base64,") == 1
        assert not re.search(r'(src|href)="(?!data:|#)', page)


def test_feedback_is_about_one_student():
    page = feedback_page(CLASS[1], [PNG])
    assert all(words in page for words in ("anna", "25 / 50", "and up to 20 by hand"))
    assert not any(name in page for name in ("Zoe", "Bob"))


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_a_phone_shows_feedback_without_scrolling_aside_and_evidence_leads_to_its_moment(tmp_path):
    sync_api = pytest.importorskip("playwright.sync_api")
    times = np.arange(0.0, 30.0, 0.02)
    poses = np.stack([times, times, times * 0.0], 1)
    replay = to_html(Replay("drive 1", "it ended", times, poses, np.ones((1, 2))))
    (tmp_path / "feedback.html").write_text(feedback_page(CLASS[1], [PNG], {1: replay}))
    files = {name: [("replay of run 1", "replay.html")] for name in ("anna", "Zoe")}
    (tmp_path / "index.html").write_text(class_page(CLASS, {}, files))
    (tmp_path / "replay.html").write_text(replay)
    with sync_api.sync_playwright() as playwright:
        flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        page = browser.new_page(viewport={"width": 390, "height": 844}, device_scale_factor=0.5)
        complaints = []
        page.on("pageerror", lambda error: complaints.append(error))
        for name in ("index.html", "feedback.html"):
            page.goto((tmp_path / name).as_uri())
            assert page.evaluate("document.documentElement.scrollWidth") == 390, name
        shown = page.frame_locator("iframe").locator("output")
        shown.get_by_text("9.20 s").wait_for()  # drives: the first item that lost points
        page.frame_locator("iframe").get_by_label("time").fill("20")
        shown.get_by_text("20.00 s").wait_for()
        page.get_by_title("the replay at this moment").click()
        shown.get_by_text("9.20 s").wait_for()
        page.goto((tmp_path / "index.html").as_uri())
        page.get_by_title("the replay at this moment").first.click()
        page.locator("output").get_by_text("9.20 s").wait_for()
        browser.close()
    assert not complaints


def test_a_replay_is_that_of_its_drive_by_number(tmp_path):
    for number in (1, 3, 10):
        (tmp_path / f"drive_{number}").mkdir()
        (tmp_path / f"drive_{number}" / "replay.html").write_text(f"drive {number}")
    (tmp_path / "drive_x").mkdir()
    (tmp_path / "drive_x" / "replay.html").touch()
    found = replays(tmp_path)
    assert list(found) == [1, 3, 10]
    items = [Item("marker", 0.0, 20.0, "wrong", at=4.0, drive=number) for number in (2, 3, 10)]
    pages = {number: path.read_text() for number, path in found.items()}
    page = feedback_page(MarkingResult("ann", "a.launch", {}, tuple(items)), [], pages)
    assert re.findall(r'href="#(drive_\d+)"', page) == ["drive_3", "drive_10"]
    shown = re.findall(r'<iframe id="drive_(\d+)"[^>]*srcdoc="drive (\d+)"', page)
    assert shown == [("1", "1"), ("3", "3"), ("10", "10")]
