"""PyBullet behind records; the only folder that imports pybullet.

Importing PyBullet prints its build time to standard error, from C. The first import happens here, with that
descriptor redirected, so that programs do not begin with a line of no use to their users.
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
