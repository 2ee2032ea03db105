"""View of RViz, for the judges of several exercises: its configuration, and its displays."""

from __future__ import annotations

from dataclasses import replace
from typing import Tuple

from husky_grading.displays import ROBOT, SCAN, TF, RvizView
from husky_grading.notes import Kind
from husky_grading.records import Item, Rules
from husky_grading.rubrics.items import by_hand

NO_VIEW = "no RViz configuration was handed in"
# hints
SAVE = (
    "save RViz's configuration in your package (File, Save Config As), and name it in the launch file by -d"
)
DISPLAYS = "add the displays that are missing, with the fixed frame odom, and save the configuration"
SAVED = "and save the configuration (File, Save Config)"
NAMES = {TF: "frames", ROBOT: "robot model", SCAN: "laser scan"}


def without_config(item: Item, view: RvizView, rules: Rules) -> Item:
    """Return the item of a submission without a configuration of RViz, by the rule `no_rviz_config`."""
    evidence = NO_VIEW
    if view.missing:
        evidence += f": its launch file names {view.missing}, which is not in the submission"
    item = replace(item, evidence=evidence, hint=SAVE)
    if rules.no_rviz_config == "zero":
        return replace(item, points=0.0)
    if rules.no_rviz_config == "person":
        # the page of the class counts the submissions that wait only for this reason
        return replace(item, points=None, evidence=by_hand(evidence), reason=Kind.NO_RVIZ_FILE)
    # the rule is "node": a submission whose launch file starts RViz gets all points
    if view.started:
        return replace(item, points=item.max_points, evidence=f"{evidence}; its launch file starts RViz")
    return replace(item, points=0.0, evidence=f"{evidence}; its launch file does not start RViz")


def hint_on_view(view: RvizView) -> str:
    """Return the hint for a configuration that shows nothing."""
    return f"set the fixed frame to odom, {SAVED}" if view.fixed_frame else "save RViz's configuration again"


def find_display_fault(view: RvizView, kind: str, scan_topic: str) -> Tuple[str, str]:
    """Return the reason why RViz does not show the frames, the robot model or the scans, and the hint.

    Args:
        view: view of RViz, without a problem.
        kind: class of the display that the view lacks: TF, ROBOT or SCAN.
        scan_topic: topic of the scans that the display of scans must show.
    """
    name = kind.rpartition("/")[2]  # name of the display in RViz, such as LaserScan
    what = NAMES[kind]  # name in a sentence, such as "laser scan"
    # Topics or robot descriptions that the displays of this kind show; all are wrong, because otherwise the
    # view would not lack this display. A TF display has no topic, so it is never wrong.
    wrong_sources = [display.source for display in view.displays if display.kind == kind]
    if wrong_sources:
        evidence = f"{what} not visible: its display shows {', '.join(wrong_sources)}"
        if kind == SCAN:
            return evidence, f"set the topic of the display {name} to {scan_topic}"
        return evidence, f"set the Robot Description of the display {name} to robot_description"
    if any(display.kind == kind for display in view.off):
        evidence = f"{what} not visible: its display is switched off or transparent"
        return evidence, f"tick the display {name}, with an alpha and a size above 0"
    return f"{what} not visible: there is no display {name}", f"add the display {name}"
