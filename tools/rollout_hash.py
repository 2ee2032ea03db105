"""SHA-256 of the true poses of one drive without ROS, to the bit and to a nanometre.

The bits differ between families of processors, because NumPy's matrix product (OpenBLAS) has a kernel for
each. Rounded poses do not differ, so a second number that changes is a change of our code, NumPy or PyBullet.

Usage: PYTHONPATH=src python tools/rollout_hash.py
"""

import hashlib
import platform

import numpy as np
import pybullet  # noqa: TID251 - for its version

from husky_evaluation.rollout import rollout
from husky_evaluation.scenarios import course_scenario


def digest(poses: np.ndarray) -> str:
    """SHA-256 of poses, an array of any shape, in 16 hexadecimal digits."""
    return hashlib.sha256(np.ascontiguousarray(poses).tobytes()).hexdigest()[:16]


trace = rollout(course_scenario(seed=0))
versions = (
    f"Python {platform.python_version()}, NumPy {np.__version__}, PyBullet API {pybullet.getAPIVersion()}"
)
# + 0.0, because a small negative number becomes -0.0, which has other bits than 0.0
rounded = np.round(trace.poses, 9) + 0.0
hashes = f"{digest(trace.poses)} to the bit, {digest(rounded)} to a nanometre"
print(f"{hashes}: {len(trace.poses)} poses, {versions}")
