"""`./dev run rostest`: rostest that finds the packages of its files as `./dev launch` does."""

import sys
from pathlib import Path

from launch import find_packages_for
from rostest import rostestmain

if __name__ == "__main__":
    for word in sys.argv[1:]:
        if Path(word).is_file():
            find_packages_for(Path(word).absolute())
    rostestmain()
