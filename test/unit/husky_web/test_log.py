"""The log of all nodes in the page: filtered, capped, and never markup."""

from types import SimpleNamespace

from husky_web.log import (
    CAPACITY,
    EARLIER,
    LEVELS,
    SHOWN,
    Filter,
    Line,
    LogBuffer,
    lines_of_rosout,
    log_to_html,
)


def line(text, level="info", node="/robot", stamp=1.0):
    header = SimpleNamespace(stamp=SimpleNamespace(to_sec=lambda: stamp))
    return SimpleNamespace(level=LEVELS[level], header=header, name=node, msg=text)


def log_of(*lines):
    log = LogBuffer()
    for each in lines:
        log.add(each)
    return log


def texts(log, **condition):
    return [row.line.text for row in log.select(Filter(**condition))]


def word(number):
    """A text of its own, without digits."""
    return "".join(chr(ord("a") + int(digit)) for digit in str(number))


def test_the_log_is_filtered_newest_first_and_capped():
    numbered = (line(word(number)) for number in range(CAPACITY + 10))
    log = log_of(*numbered, line("Pillar lost", "warn", "/controller"))
    assert texts(log)[:2] == ["Pillar lost", word(CAPACITY + 9)]
    assert len(texts(log)) == SHOWN
    assert texts(log, level=LEVELS["warn"]) == ["Pillar lost"]
    assert texts(log, node="contr", text="pillar") == ["Pillar lost"]
    assert texts(log, text=word(3) + " ") == []
    assert log.warning.text == "Pillar lost"


def test_lines_that_differ_in_numbers_are_counted_in_one_row_unless_a_text_is_searched():
    driving = [line(f"driving, {number}.5 m to go", node="/a") for number in (3, 2, 1)]
    log = log_of(*driving[:2], line("arrived", node="/a"), driving[2], line("driving, 9 m to go", node="/b"))
    rows = [(row.line.node, row.line.text, row.times) for row in log.select(Filter())]
    assert rows == [("/b", "driving, 9 m to go", 1), ("/a", "driving, 1.5 m to go", 3), ("/a", "arrived", 1)]
    assert "&times;3" in log_to_html(log.select(Filter()))
    assert len(log.select(Filter(text="driving"))) == 4


ROSOUT = """the end of a line that is cut off
0.000000000  Node Startup
0.020000000 INFO /controller [node.py:12(Node.run)] [topics: /clock, /rosout] driving [2 pillars]
1795748647.638548000 WARN /smb/driver two
lines, and [brackets]
7.500000000 ERROR /cpp [/src/a.cpp:5(main)] [topics: /rosout] boom
"""


def test_what_rosout_has_written_before_comes_before_each_line_once():
    earlier = lines_of_rosout(ROSOUT)
    assert earlier == [
        Line(LEVELS["info"], 0.02, "/controller", "driving [2 pillars]"),
        Line(LEVELS["warn"], 1795748647.638548, "/smb/driver", "two\nlines, and [brackets]"),
        Line(LEVELS["error"], 7.5, "/cpp", "boom"),
    ]
    log = log_of(line("driving [2 pillars]", node="/controller", stamp=0.02), line("newest"))
    log.add_earlier(earlier)
    assert texts(log) == ["newest", "driving [2 pillars]", "boom", "two\nlines, and [brackets]"]
    assert log.count == 4, "so that pages draw it anew"
    log = log_of(*(line(word(number)) for number in range(CAPACITY - 5)))
    log.add_earlier(lines_of_rosout("".join(f"1.0 INFO /n {number}\n" for number in range(2 * EARLIER))))
    assert texts(log)[0] == word(CAPACITY - 6), "what is new stays"
    oldest = [kept.text for kept in list(log._lines)[:5]]
    assert oldest == [str(number) for number in range(2 * EARLIER - 5, 2 * EARLIER)]


def test_lines_of_the_log_are_cut_are_never_markup_and_show_the_time_of_day_where_it_is_wall_time():
    assert len(log_to_html(log_of(*[line("x" * 200_000)] * 20).select(Filter()))) < 40_000
    hostile = line("<script>alert(1)</script>", node="/<b>")
    times = (line("a", stamp=12.5), line("b", stamp=1700000000.0))
    html = log_to_html(log_of(hostile, *times).select(Filter()))
    assert "<script>" not in html
    assert "/<b>" not in html
    assert ">12.50<" in html
    assert ">22:13:20<" in html
