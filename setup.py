"""Catkin reads this; do not call it by hand."""

from pathlib import Path

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

SOURCES = Path(__file__).parent / "src"

setup(
    **generate_distutils_setup(
        packages=sorted(
            ".".join(folder.parent.relative_to(SOURCES).parts) for folder in SOURCES.rglob("__init__.py")
        ),
        package_dir={"": "src"},
    )
)
