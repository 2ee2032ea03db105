"""Review page in a real browser: keys give points, which it saves as marking.yaml."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from husky_grading.isolation import files
from husky_grading.notes import Kind, Subject
from husky_grading.recording import MarkerSample, Recording, recording_to_json, scan_hits
from husky_grading.records import Item, Job, MarkingConfig, MarkingResult
from husky_grading.reports.files import load_result, write_result
from husky_grading.review import OpenItem, open_items, write_review
from husky_grading.settings import read_overrides
from husky_highlevel_controller.config import ConfigError, to_json
from husky_highlevel_controller.datatypes import HuskyError, Pose2D, Scan

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
TIMES = np.arange(0.0, 10.0, 0.02)
POSES = np.stack([TIMES, 0.0 * TIMES, 0.0 * TIMES], 1)
SCAN = Scan(4.0, "front_laser", -0.1, 0.1, 0.1, 30.0, np.array([15.0, np.inf, 15.2]))
DRIVE = Recording(
    Pose2D(), (20.0, 0.0), 60.0, TIMES, POSES, POSES[:, :2], TIMES,
    hits=scan_hits([SCAN], TIMES, POSES, "husky"),
    markers=(MarkerSample("/marker", "", 0, 3.0, 0.0, "odom", (19.0, 1.0, 0.5)),),
)  # fmt: skip
RVIZ, MARKER = "RViz shows TF, robot model, laser scan", "marker in RViz"


@pytest.fixture
def review(tmp_path):
    """Two students, three open items; marking.yaml has an entry already."""
    folder = tmp_path / "class"
    for name, items in (("ann", (RVIZ, MARKER)), ("bob", (RVIZ,))):
        (folder / name).mkdir(parents=True)
        out = tmp_path / "out" / "hand_ins" / name
        (out / "ws" / "src" / "husky").mkdir(parents=True)
        (out / "ws" / "src" / "husky" / "a.launch").write_text(
            '<node pkg="rviz" name="<script>alert(1)</script>"/>'
        )
        (out / "job.json").write_text(
            to_json(Job(name, str(out), MarkingConfig(), hand_in=str(folder / name)))
        )
        (out / "drive_1").mkdir()
        (out / "drive_1" / "recording.json").write_text(recording_to_json(DRIVE))
        left = [Item(item, None, 20.0, "by hand: none", subject=Subject.DISPLAYS) for item in items]
        write_result(
            MarkingResult(name, "a.launch", {}, (Item("reaches the pillar", 30.0, 30.0, "stands"), *left)),
            out,
        )
    (folder / "marking.yaml").write_text("# mine\nstudents: {bob: {late: {percent: 10, word: late}}}\n")
    return tmp_path / "out", folder


@pytest.fixture
def page():
    """A page of a browser."""
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("needs chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser.new_page()
        browser.close()


def save(page, folder):
    """Save marking.yaml by the review's key."""
    with page.expect_download() as saved:
        page.keyboard.press("s")
    saved.value.save_as(folder / "marking.yaml")


def test_keys_give_the_points_of_a_student_s_item_and_the_page_saves_them_as_marking_yaml(review, page):
    out, folder = review
    said = []
    page.on("dialog", lambda dialog: said.append(dialog.message))
    page.goto(write_review(out).as_uri())
    page.get_by_role("heading", name=f"ann: {RVIZ}").wait_for()
    assert "<script>alert(1)" in page.locator("pre:visible").inner_text(), "as text"
    picture = page.locator("img:visible").first
    assert picture.evaluate("image => image.decode().then(() => image.naturalWidth)") > 600
    page.keyboard.press("w")
    page.keyboard.type("two of 3 displays")
    page.keyboard.press("Enter")
    page.keyboard.press("5")
    page.get_by_role("heading", name=f"ann: {MARKER}").wait_for()
    page.keyboard.press("n")
    page.get_by_role("heading", name=f"bob: {RVIZ}").wait_for()
    page.keyboard.press("9")
    page.reload()
    page.get_by_role("heading", name=f"ann: {MARKER}").wait_for()
    assert "2 done" in page.get_by_role("status").inner_text(), "kept where the page is closed"
    save(page, folder)
    assert not said
    given = read_overrides(folder, ["ann", "bob"])
    points, word = given["ann"].points[RVIZ].points, given["ann"].points[RVIZ].word
    assert (points, word) == (10.0, "two of 3 displays")
    assert MARKER not in given["ann"].points
    assert given["bob"].points[RVIZ].points == 20.0
    assert given["bob"].late.percent == 10.0, "what was there stays"
    shutil.rmtree(folder / "ann")
    (folder / "marking.yaml").unlink()
    page.goto(write_review(out).as_uri())
    status = page.get_by_role("status").inner_text()
    save(page, folder)
    saved = (folder / "marking.yaml").read_text()
    # once, on a busy machine, the file had no points of bob; this tells whether the page had lost them
    assert "bob" in saved, f"the page says '{status}', and saves: {saved}"
    given = read_overrides(folder, ["bob"])
    assert given["bob"].points[RVIZ].points == 20.0, "his own, not the first item's"


def test_one_key_gives_the_points_to_all_hand_ins_that_lack_the_same(review, page):
    out, folder = review
    (folder / "marking.yaml").write_text("students: {ann: }")  # an empty entry is one without keys
    for path in (out / "hand_ins").glob("*/result.json"):
        result = load_result(path)
        items = [replace(each, reason=Kind.NO_RVIZ_FILE) for each in result.items]
        write_result(replace(result, items=tuple(items)), path.parent)
    page.goto(write_review(out).as_uri())
    for key in ("a", "1"):
        page.keyboard.press(key)
    save(page, folder)
    given = read_overrides(folder, ["ann", "bob"])
    assert given["ann"].points == given["bob"].points, "another item of the same student is another thing"
    assert given["bob"].points[RVIZ].points == 0.0


def test_a_student_may_be_called_as_a_property_of_every_object(review, page):
    out, folder = review
    for path in (out / "hand_ins").glob("*/result.json"):
        name = {"ann": "constructor", "bob": "__proto__"}[path.parent.name]
        write_result(replace(load_result(path), name=name), path.parent)
    (folder / "marking.yaml").write_text("students: {__proto__: {hold: true}}")
    page.goto(write_review(out).as_uri())
    for key in "915":
        page.keyboard.press(key)
    save(page, folder)
    given = read_overrides(folder, ["constructor", "__proto__"])
    assert given["constructor"].points[RVIZ].points == 20.0
    assert (given["__proto__"].points[RVIZ].points, given["__proto__"].hold) == (10.0, True)


def test_too_many_files_that_a_build_made_leave_the_page(review, monkeypatch):
    monkeypatch.setattr(files, "MAX_ENTRIES", 3)
    for number in range(4):
        (review[0] / "hand_ins" / "ann" / "ws" / "src" / f"{number}.txt").touch()
    codes = {item.student: item.code[0] for item in open_items(review[0])[0]}
    assert codes == {"ann": "", "bob": "husky/a.launch:1"}


def test_code_is_found_in_a_time_that_grows_with_its_length_and_a_line_without_end_is_cut(review):
    item = replace(open_items(review[0])[0][1], item=Item("marker", None, 20.0, "", subject=Subject.MARKER))
    source = item.out / "ws" / "src" / "husky" / "a.cpp"
    source.write_text(("Marker" * 83 + "\n") * 400)  # once two minutes
    assert item.code == ("", "")
    for line in ("visualization_msgs::Marker marker;", "self.marker = Marker()", "Marker m = {};"):
        source.write_text(f"{'Marker' * 30_000}\n{line}\n")
        place, code = item.code
        assert place == "husky/a.cpp:2"
        assert max(map(len, code.splitlines())) < 1000


@pytest.mark.parametrize("name", ["job.json", "result.json", ""])
def test_a_student_who_is_gone_or_has_an_unreadable_file_leaves_the_others(review, name, capsys):
    out, folder = review
    if name:
        (out / "hand_ins" / "ann" / name).write_text('{"schema": 1}')
    else:
        shutil.rmtree(folder / "ann")
    assert {item.student for item in open_items(out)[0]} == {"bob"}
    assert not name or f"ann/{name}" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["students: [", "students: !!bool x", "students: {ann: {lunch: 3}}"])
def test_a_broken_marking_file_and_a_folder_without_results_are_named(review, text):
    out, folder = review
    (folder / "marking.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"marking\.yaml"):
        write_review(out)
    with pytest.raises(HuskyError, match="no results of one class"):
        write_review(folder)


def test_beams_of_a_lidar_that_hangs_upside_down_end_where_the_world_is():
    scan = Scan(5.0, "front_laser", -1.0, 1.0, 0.1, 30.0, np.array([2.0, np.nan, 3.0]))
    (t, x, y), (_, u, v) = scan_hits([scan], TIMES, POSES, "husky")
    along, across = 2.0 * np.cos(1.0), 2.0 * np.sin(1.0)
    assert (t, x, y) == pytest.approx((5.0, 5.337 + along, across), abs=2e-3), (
        "a negative angle is on the left"
    )
    assert (u, v) == pytest.approx((5.337 + 1.5 * along, -1.5 * across), abs=2e-3)


@pytest.mark.parametrize("full", [20.0, 33.3, 16.7, 0.2])
def test_the_last_key_gives_exactly_all_points_and_no_key_gives_more(full, tmp_path):
    points = [points for _, points in OpenItem("ann", Item("drives", None, full, ""), tmp_path).choices]
    assert (points[0], points[-1], max(points)) == (0.0, full, full)
