"""SHA-256 of the true poses of one drive without ROS: the same on every Python, or NumPy and PyBullet differ.

Usage: PYTHONPATH=src python tools/rollout_hash.py
"""

import hashlib
import platform

import numpy as np
import pybullet  # noqa: TID251 - for its version

from husky_evaluation.rollout import rollout
from husky_evaluation.scenarios import course_scenario

trace = rollout(course_scenario(seed=0))
digest = hashlib.sha256(np.ascontiguousarray(trace.poses).tobytes()).hexdigest()
versions = (
    f"Python {platform.python_version()}, NumPy {np.__version__}, PyBullet API {pybullet.getAPIVersion()}"
)
print(f"{digest[:16]} {len(trace.poses)} poses, {versions}")
