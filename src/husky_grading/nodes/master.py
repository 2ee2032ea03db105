"""ROS master as a program that can be forked."""

from __future__ import annotations

import sys

from rosmaster.main import rosmaster_main


def main() -> None:
    """Run it: `--core -p PORT`."""
    rosmaster_main(sys.argv)
