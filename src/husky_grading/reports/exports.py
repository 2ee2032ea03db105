"""Results in the forms of teaching platforms: Gradescope, Classroom 50, GitHub's step summary.

Forms: Gradescope's autograder specification (results.json); foundation50/classroom50, "The result.json
contract" of its wiki; GitHub Actions, "Adding a job summary".
"""

from __future__ import annotations

import json
from typing import Any, Dict, List, Mapping

from husky_grading.records import MarkingResult
from husky_grading.reports.tables import to_markdown

CLASSROOM50_SCHEMA = "classroom50/result/v1"
# environment variable with the value of each field of result.json; the runner of Classroom 50 sets them
CLASSROOM50_FIELDS = {
    "classroom": "CLASSROOM",
    "assignment": "ASSIGNMENT",
    "submission": "SUBMISSION_TAG",
    "commit": "COMMIT_URL",
    "release": "RELEASE_URL",
    "review": "REVIEW_URL",
}


def exports(result: MarkingResult, variables: Mapping[str, str], moment: str) -> Dict[str, str]:
    """Return the text of each platform's file, by the path that it expects; an empty text means no file.

    Classroom 50 needs a score, so it gets no file for a submission that could not be marked.

    Args:
        result: result of the student.
        variables: environment, in which the runner of Classroom 50 names the submission.
        moment: time of the result in UTC, such as 2026-06-01T14:32:01Z.
    """
    return {
        "gradescope/results.json": to_gradescope(result),
        "classroom50/result.json": "" if result.problem else to_classroom50(result, variables, moment),
        "github/summary.md": to_markdown([result]),
    }


def to_gradescope(result: MarkingResult) -> str:
    """Return results.json of Gradescope: a test for each item, without a score if it is graded by hand."""
    tests: List[Dict[str, Any]] = []
    for item in result.items:
        test: Dict[str, Any] = {"name": item.name, "output": item.evidence, "output_format": "text"}
        if item.points is not None:
            test.update(score=item.points, max_score=item.max_points)
            test["status"] = "passed" if item.full else "failed"
        tests.append(test)
    content: Dict[str, Any] = {"output_format": "text", "tests": tests}
    if result.problem:
        content["output"] = "\n".join([f"could not be marked: {result.problem}", *result.notes])
    else:
        content.update(output="\n".join(result.notes), score=result.points)
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def to_classroom50(result: MarkingResult, variables: Mapping[str, str], moment: str) -> str:
    """Return result.json of Classroom 50, whose scores are whole numbers.

    The environment `variables` of its runner name the submission; `moment` is like 2026-06-01T14:32:01Z.
    """
    tests: List[Dict[str, Any]] = [
        {
            "test-name": item.name,
            "passed": item.full,
            "score": round(item.points),
            "max-score": round(item.max_points),
            "evidence": item.evidence,
        }
        for item in result.items
        if item.points is not None
    ]
    # fields that name the submission; a field is empty if the runner has not set its variable
    fields = {field: variables.get(name, "") for field, name in CLASSROOM50_FIELDS.items()}
    # if there is no page for reviews, `review` has the address of the commit's page
    fields["review"] = fields["review"] or fields["commit"]
    # sums of the rounded scores, so that the sums agree with the scores in `tests`
    sums = {name: sum(test[name] for test in tests) for name in ("score", "max-score")}
    content = {"schema": CLASSROOM50_SCHEMA, **fields, "datetime": moment, **sums, "tests": tests}
    return json.dumps(content, indent=2) + "\n"
