"""Points and sentences that the submissions here get, and the recordings in test/data/markings."""

import json
import lzma
import re
from dataclasses import replace
from pathlib import Path

import pytest

from husky_grading.judge import judge_again
from husky_grading.recording import RECORDING
from husky_grading.records import Job, MarkingConfig
from husky_grading.submission import WORKSPACE

FILES = Path(__file__).parents[1] / "data" / "markings"
NEAR = MarkingConfig(robot="husky", deadline=15.0, pace=8.0, trials=1)
CONFIGS = {  # of those that are not marked in this way
    "is_for_an_older_husky": replace(NEAR, robot="auto"),
    "listens_to_laser": replace(NEAR, robot="auto"),
    "prints_ranges": MarkingConfig(exercise=2, robot="husky", pace=4.0),
    "reference": MarkingConfig(robot="husky", trials=2, seed=7),
    "reference_of_exercise_5": MarkingConfig(exercise=5, robot="husky", pace=4.0),
}
UNJUDGED = ("hits", "workspace", "root", "made_of")  # keys of these files
# whose end depends on processes: every run of the tests drives them
DRIVEN = (
    "complete", "crashes", "floods", "forges_the_truth", "hangs", "needs_a_missing_package",
    "sends_junk", "sleeps_by_simulated_time", "teleports",
)  # fmt: skip

# points for: drives towards it, reaches it, RViz, marker's place, marker in RViz (None: by hand, since
# no RViz configuration was handed in); and sentences that it is told
ALL, NOTHING, STARTS = (20, 30, 20, 20, 10), (0, 0, None, 0, 0), (10, 0, None, 0, 0)
ARRIVES, UNMARKED = (20, 30, None, 20, None), (20, 30, None, 0, 0)


def arrives(marker, within=1.0):
    """Points of one that reaches the pillar, and about so many for its marker."""
    return (20, 30, None, pytest.approx(marker, abs=within), None)


DESERVED = {
    "complete": (ALL, ["odom, stamp 0: right 100 %", "visible: frames, robot model, laser scan"]),
    "crashes": (STARTS, ["ends during the run (exit code 1): ZeroDivisionError", "stops short"]),
    "hangs": (STARTS, ["does not answer every scan", "stops short: nearest 6."]),
    "never_publishes": (NOTHING, ["never moves: nothing came on cmd_vel", "publish the velocity"]),
    "raises_in_callback": (
        NOTHING,
        ["raises NameError: name 'minimum' is not defined (controller:11), first at 0.", "the line that is"],
    ),
    "never_advertises": (NOTHING, ["never moves: it advertises no cmd_vel", "advertise geometry_msgs/Twist"]),
    "floods": (UNMARKED, ["it floods cmd_vel: "]),
    "sends_junk": (UNMARKED, [" messages on /viz are not of its type, so they are ignored"]),
    "drives_away": (
        (0, 0, None, 20, None),
        ["drives away: ", "it drives backwards", "check the sign of linear.x"],
    ),
    "spins": ((0, 0, None, pytest.approx(19.6, abs=0.2), None), ["turns round ", "inf or NaN"]),
    "stops_short": ((20, 0, None, 0, 0), ["stops short: nearest 2."]),
    "rams": (ARRIVES, ["reaches it, at 1.0"]),  # the sheet's "hits the pillar"
    "marks_the_origin": ((20, 30, 20, 0, 0), ["right 0 % of", ", 0.13), the pillar at (20.00, 5.00): "]),
    "imports_what_is_missing": (NOTHING, ["ModuleNotFoundError: No module named 'no_such_package'"]),
    "needs_a_missing_package": (
        UNMARKED,
        ["package 'no_such_package' is missing; the <include> that needs it is left out", "stands "],
    ),
    # traps: what students do that a person would not mark down, and the first cause in the chain
    "sleeps_by_simulated_time": (ARRIVES, ["front_laser, stamp 0: right "]),
    "marks_in_base_link": (
        arrives(9.6, 0.3),
        ["0.54 m from the pillar's axis", "0.33 m in front of the pillar, seen", "not in base_link's origin"],
    ),
    "commands_zero": (NOTHING, ["never moves: all ", "commands were zero", "a gain of 0"]),
    "listens_elsewhere": (NOTHING, ["it subscribes to /scan, where nothing is published", "`rostopic list`"]),
    # attacks
    "teleports": (NOTHING, ["no points: the simulator was asked to interfere", "the robot jumps "]),
    "forges_the_truth": (NOTHING, ["no points: node /rosout publishes on /ground_truth/odom, "]),
    "steers_by_the_truth": (NOTHING, ["/controller subscribes to /husky_simulator/world/update_full, "]),
    "marks_a_grid": (UNMARKED, ["196 markers in namespace 'grid'"]),
    "blocks_readers": ((0, 0, 0, 0, 0), ["the robot never moves: all "]),
    "breaks_readers": ((0, 0, 0, 0, 0), ["'xterm -e' of node controller is dropped", " cannot be started"]),
    "forges_events": (NOTHING, ["ends during the ", " (signal 11, SIGSEGV)"]),
    "hides": (NOTHING, ["no marker at the pillar that could be shown"]),
    "counts_ids": (UNMARKED, ["half of the drawn ones must be right"]),
    # controllers of the simulator's package, which are nobody's hand-in
    "starts_the_naive_one": (NOTHING, ["highlevel_controller/naive_controller is left out: it is a node of"]),
    "starts_the_reference": (NOTHING, ["highlevel_controller/husky_controller is left out: it is a node of"]),
    "imports_the_reference": (NOTHING, ["ends during the ", " (exit code 1): ModuleNotFoundError: "]),
    # other robots and exercises
    "is_for_an_older_husky": (ARRIVES, ["/scan"]),
    "listens_to_laser": (ARRIVES, ["scans are sent on /laser, the only topic of scans that it subscribes "]),
    "prints_ranges": ((40, None, 15, None), []),
    "reference": (ALL, ["the same points in another world"]),
    "reference_of_exercise_5": ((50, 50, None, None), ["stands after 2 of 2 calls", "drives after 2 of 2 "]),
    "does_not_build": (NOTHING, ["it does not build: ", "expected primary-expression", "fix this error"]),
    # faults, each named as it is in the code
    "turns_too_slowly": (
        (10, 0, None, 20, None),
        ["too slowly for 1.0 m/s: a larger gain", "the same as for 'drives towards the pillar'"],
    ),
    "swaps_x_and_y": (UNMARKED, ["x and y are swapped", "x is ahead, y to the left"]),
    "takes_another_beam": (UNMARKED, ["its distance is right, its angle is not", "angle_min + index"]),
    "cuts_to_whole_metres": (arrives(5.2), ["coordinates are whole metres", "the position in double"]),
    "forgets_y": (arrives(15.0), ["y is always 0", "give the marker a y, too"]),
    "marks_nan": (UNMARKED, ["leave out ranges that are inf or NaN"]),
    "never_turns": (
        (10, 0, None, pytest.approx(18.0, abs=2.0), None),
        ["it never turns: angular.z is 0 in all commands", "a gain that is read into an int is cut to 0"],
    ),
    "creeps": (
        (0, 0, None, 20, None),
        ["the robot never moves: all ", "zero", "a gain of 0"],
    ),
    "keeps_no_subscriber": (
        NOTHING,
        ["it does not subscribe to the scans", "a local one ends with its function"],
    ),
    "hides_its_displays": (
        (20, 30, 13, 20, 0),
        ["laser scan not visible: its display is switched off", "tick the display LaserScan",
         "display of /visualization_marker is switched off", "tick the display Marker"],
    ),
    "marks_twice": ((0, 0, None, 0, 0), ["2 commands, the last at", "mirrored: ", "and change no sign"]),
    "marks_itself": (
        (0, 0, None, pytest.approx(19.6, abs=0.2), None),
        ["on the lidar where no beam has a return", "sits on the lidar, so publish none then"],
    ),
    "includes_a_missing_file": (
        (0, 0, 20, 0, 0),
        ["includes_a_missing_file/launch/other.launch", "hand in the file that is named"],
    ),
    "starts_a_map_server": (
        (0, 0, None, 20, None),
        ["the robot never moves: nothing came on cmd_vel", "node map_server/map_server cannot be started"],
    ),
    "drives_by_chance": (
        (None, None, None, None, None),
        [
            "by hand: `start_` (controller.cpp:36) is read", "by chance, as above; in",
            "value in the constructor", "change no sign",
        ],
    ),
}  # fmt: skip
ATTACKS = ("forges_events", "hides")  # of the package `attacks`
KEPT = tuple(name for name in DESERVED if name not in DRIVEN)


def check(name, result):
    """Points and sentences of a submission's result."""
    points, sentences = DESERVED[name]
    assert tuple(item.points for item in result.items) == points, result
    said = "\n".join([*(f"{item.evidence}; {item.hint}" for item in result.items), *result.notes])
    for sentence in sentences:
        assert sentence in said, said


def keep(name, out):
    """Write what judging a marking needs of its folder to test/data/markings."""
    parts = {}
    for path in [out / WORKSPACE, *out.glob(f"drive_*/{RECORDING}")]:
        text = path.read_text().replace(f"{out}/", "")
        content = json.loads(text, parse_float=lambda text: round(float(text), 3))
        if "output" in content:  # exercise 2 reads what was printed, but not addresses and the wall time
            printed = content["output"] if CONFIGS.get(name, NEAR).exercise == 2 else ""
            content["output"] = re.sub(r"http\S+|\b\d{10}\.\d+", "0", printed)
        parts[str(path.relative_to(out))] = {key: content[key] for key in content if key not in UNJUDGED}
    FILES.mkdir(exist_ok=True)
    (FILES / f"{name}.json.xz").write_bytes(lzma.compress(json.dumps(parts).encode(), preset=9))


def judge_kept(name, out, sentences=""):
    """The result of a submission by its kept recordings, unpacked into a folder.

    With `sentences`, each note in them says that instead.
    """
    parts = json.loads(lzma.decompress((FILES / f"{name}.json.xz").read_bytes()))
    for place, content in parts.items():
        text = json.dumps(content)
        if sentences:
            text = re.sub(r'"text": "(?:[^"\\]|\\.)*"', f'"text": "{sentences}"', text)
        (out / place).parent.mkdir(exist_ok=True)
        (out / place).write_text(text)
    return judge_again(Job(name, str(out), CONFIGS.get(name, NEAR)))
