"""PyBullet behind records; the only folder that imports pybullet.

The first import of PyBullet prints its build time to standard error, from C. This import happens here, with
standard error redirected, because the line would only confuse the users of our programs.
"""

from __future__ import annotations

import os


def _import_silently() -> None:
    """Import PyBullet without the line that its C code prints to standard error at the first import."""
    # C code writes to descriptor 2 (standard error), so replacing `sys.stderr` would not be enough
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        import pybullet  # noqa: F401 - to have it imported
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)


_import_silently()
