"""Review page in a real browser: keys give points, which marking.yaml then holds; no other page writes it."""

import json
import multiprocessing
import shutil
import threading
from contextlib import contextmanager
from dataclasses import replace
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
import yaml

from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.datatypes import HuskyError, Pose2D, Scan
from husky_highlevel_controller.grading.notes import Kind, Subject
from husky_highlevel_controller.grading.recording import MarkerSample, Recording, scan_hits
from husky_highlevel_controller.grading.recording import to_json as recording_to_json
from husky_highlevel_controller.grading.records import Item, Job, MarkingConfig, Result, to_json
from husky_highlevel_controller.grading.reports.files import write_result
from husky_highlevel_controller.grading.review import Review, make_server
from husky_highlevel_controller.grading.settings import read_overrides

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
        left = [Item(item, None, 20.0, "for a person: none", subject=Subject.DISPLAYS) for item in items]
        write_result(
            Result(name, "a.launch", {}, (Item("reaches the pillar", 30.0, 30.0, "stands"), *left)), out
        )
    (folder / "marking.yaml").write_text("# mine\nstudents: {bob: {late: {percent: 10, word: late}}}\n")
    return Review(tmp_path / "out")


@contextmanager
def served(review):
    server, address = make_server(review)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield address
    finally:
        server.shutdown()
        server.server_close()


def status_of(address, data, headers):
    try:
        with urlopen(Request(address, data=data, headers=headers)) as answer:
            return answer.status
    except HTTPError as refused:
        refused.close()
        return refused.code


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_keys_give_the_points_and_go_on(review):
    sync_api = pytest.importorskip("playwright.sync_api")
    with served(review) as address, sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        said = []
        page.on("dialog", lambda dialog: said.append(dialog.message))
        page.goto(address)
        page.get_by_role("heading", name=f"ann: {RVIZ}").wait_for()
        assert "<script>alert(1)" in page.inner_text("pre"), "as text"
        picture = page.get_by_alt_text("robot, scan and marker at a moment of the drive")
        assert picture.evaluate("image => image.decode().then(() => image.naturalWidth)") > 600
        page.keyboard.press("w")
        page.keyboard.type("two of 3 displays")
        page.keyboard.press("Enter")
        page.keyboard.press("5")
        page.get_by_role("heading", name=f"ann: {MARKER}").wait_for()
        page.keyboard.press("n")
        page.get_by_role("heading", name=f"bob: {RVIZ}").wait_for()
        page.get_by_role("button", name="20", exact=False).last.click()
        page.get_by_role("heading", name="All 3 items have points").wait_for()
        page.goto(address)
        page.get_by_role("heading", name=f"ann: {MARKER}").wait_for()
        browser.close()
        assert not said
    given = read_overrides(review.folder, ["ann", "bob"])
    points, word = given["ann"].points[RVIZ].points, given["ann"].points[RVIZ].word
    assert (points, word) == (10.0, "two of 3 displays")
    assert MARKER not in given["ann"].points
    assert given["bob"].points[RVIZ].points == 20.0
    assert given["bob"].late.percent == 10.0, "what was there stays"
    assert (review.folder / "marking.yaml.before").read_text().startswith("# mine")


def test_a_student_who_is_gone_has_no_open_items(review):
    shutil.rmtree(review.folder / "bob")
    assert {item.student for item in Review(review.items[0].out.parents[1]).items} == {"ann"}


def test_a_line_without_end_of_a_student_s_code_is_cut(review):
    item = replace(review.items[1], item=Item("marker", None, 20.0, "", subject=Subject.MARKER))
    (item.out / "ws" / "src" / "husky" / "a.cpp").write_text("Marker" * 30_000 + "\n" + "Marker marker;\n")
    place, code = item.code
    assert place == "husky/a.cpp:2"
    assert max(map(len, code.splitlines())) < 1000


def test_code_is_found_in_a_time_that_grows_with_its_length(review):
    item = replace(review.items[1], item=Item("marker", None, 20.0, "", subject=Subject.MARKER))
    source = item.out / "ws" / "src" / "husky" / "a.cpp"
    source.write_text(("Marker" * 83 + "\n") * 400)  # once two minutes
    assert item.code == ("", "")
    for line in ("visualization_msgs::Marker marker;", "self.marker = Marker()", "Marker m = {};"):
        source.write_text(f"MarkerArray array_;\n{line}\n")
        assert item.code[0] == "husky/a.cpp:2"


def test_two_reviews_of_one_class_lose_no_points(review):
    again = Review(review.items[0].out.parents[1])
    context = multiprocessing.get_context("fork")
    writers = [
        context.Process(target=give_often, args=(each, number))
        for each, number in ((review, 0), (again, 1), (review, 2))
    ]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join(60.0)
        assert writer.exitcode == 0
    given = read_overrides(review.folder, ["ann", "bob"])
    assert [given["ann"].points[RVIZ].word, given["ann"].points[MARKER].word] == ["24", "24"]
    assert given["bob"].points[RVIZ].word == "24"
    assert given["bob"].late.percent == 10.0


def test_one_key_gives_the_points_to_all_hand_ins_that_lack_the_same(review):
    alike = [replace(each, item=replace(each.item, reason=Kind.NO_RVIZ_FILE)) for each in review.items]
    review.items = alike
    review.give(0, 0.0, "no file", to_all_alike=True)
    assert review.given == [True, False, True], "another item of the same student is another thing"
    given = read_overrides(review.folder, ["ann", "bob"])
    assert given["ann"].points[RVIZ] == given["bob"].points[RVIZ]


def give_often(review, number):
    for word in range(25):
        review.give(number, 10.0, str(word))


@pytest.mark.parametrize("text", ["students:", "students: {ann: }", "students: {ann: {points: }}"])
def test_an_empty_entry_is_one_without_keys(review, text):
    (review.folder / "marking.yaml").write_text(text)
    assert not any(review.given)
    review.give(0, 10.0, "")
    assert review.given == [True, False, False]


@pytest.mark.parametrize("name", ["job.json", "result.json"])
def test_an_unreadable_file_of_one_student_leaves_the_others(review, name, capsys):
    (review.items[0].out / name).write_text('{"schema": 1}')
    assert {item.student for item in Review(review.items[0].out.parents[1]).items} == {"bob"}
    assert f"ann/{name}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"points": 21, "word": ""}, 400),
        ({"points": -1, "word": ""}, 400),
        ({"points": float("nan"), "word": ""}, 400),
        ({"points": "all", "word": ""}, 400),
        ([], 400),
        ("[" * 5000, 400),
        ({"word": "x" * 20000, "points": 1}, 400),
    ],
)
def test_what_is_no_points_changes_nothing(review, body, code):
    before = (review.folder / "marking.yaml").read_text()
    text = body if isinstance(body, str) else json.dumps(body)
    with served(review) as address:
        assert status_of(f"{address}0", text.encode(), {}) == code
    assert (review.folder / "marking.yaml").read_text() == before


@pytest.mark.parametrize(
    ("path", "headers"),
    [("/0", {}), ("/wrong/0", {}), (None, {"Origin": "http://evil.org"}), (None, {"Origin": "null"}),
     (None, {"Host": "evil.org"})],
)  # fmt: skip
def test_no_other_page_and_no_other_user_writes(review, path, headers):
    with served(review) as address:
        place = f"{address}0" if path is None else address.rsplit("/", 2)[0] + path
        data = json.dumps({"points": 1, "word": ""}).encode()
        assert status_of(place, data, headers) == 403
    assert "points" not in (review.folder / "marking.yaml").read_text()


def test_a_broken_marking_file_is_named_and_kept(review):
    (review.folder / "marking.yaml").write_text("students: [")
    with pytest.raises(ConfigError, match=r"marking\.yaml"):
        review.give(0, 10.0, "")
    assert (review.folder / "marking.yaml").read_text() == "students: ["
    (review.folder / "marking.yaml").write_text(yaml.safe_dump({"students": {"ann": {"robot": "husky"}}}))
    review.give(0, 10.0, "")
    assert read_overrides(review.folder, ["ann", "bob"])["ann"].robot == "husky"


def test_a_folder_without_results_is_named(tmp_path):
    with pytest.raises(HuskyError, match="no results of one class"):
        Review(tmp_path)


def test_beams_of_a_lidar_that_hangs_upside_down_end_where_the_world_is():
    scan = Scan(5.0, "front_laser", -1.0, 1.0, 0.1, 30.0, np.array([2.0, np.nan, 3.0]))
    (t, x, y), (_, u, v) = scan_hits([scan], TIMES, POSES, "husky")
    along, across = 2.0 * np.cos(1.0), 2.0 * np.sin(1.0)
    assert (t, x, y) == pytest.approx((5.0, 5.337 + along, across), abs=2e-3), (
        "a negative angle is on the left"
    )
    assert (u, v) == pytest.approx((5.337 + 1.5 * along, -1.5 * across), abs=2e-3)
