"""Program of the ROS master of `./dev launch`; its package is the one beside it, whatever ROS finds first."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "src"))

from husky_highlevel_controller.ros.parameter_master import main

if __name__ == "__main__":
    main()
