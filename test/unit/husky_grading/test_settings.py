"""Settings of a teacher: points by hand and a late penalty."""

from husky_grading.records import Item, Late, MarkingResult, Override
from husky_grading.reports.tables import to_result
from husky_grading.settings import with_override


def test_a_late_penalty_of_nothing_is_0_and_not_minus_0():
    result = MarkingResult("ann", "a.launch", {}, (Item("drives", 0.0, 20.0, "stands"),))
    late = with_override(result, Override(late=Late(10.0, "a day late")))
    assert str(late.items[-1].points) == "0.0"
    assert "-0/0" not in str(to_result(late))
