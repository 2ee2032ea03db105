"""`./dev test -m fuzz` runs thousands of cases of each kind, the normal run a few; both are seeded."""

import pytest
from damage import generators


@pytest.fixture(
    params=[pytest.param(30, id="short"), pytest.param(3000, id="long", marks=[pytest.mark.fuzz])]
)
def cases(request):
    """A random generator for each case."""
    return generators(request.node.originalname, request.param)
