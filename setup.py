"""Catkin reads this; do not call it by hand. `pip install .` reads pyproject.toml instead."""

from pathlib import Path

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import Distribution, setup

SOURCES = Path(__file__).parent / "src"


class CatkinPackage(Distribution):
    """A distribution without the commands of pyproject.toml: catkin's are in scripts/."""

    def parse_config_files(self, filenames=None, ignore_option_errors=False):
        """Read those of distutils only."""
        super().parse_config_files(self.find_config_files(), ignore_option_errors)


setup(
    distclass=CatkinPackage,
    **generate_distutils_setup(
        packages=sorted(
            ".".join(folder.parent.relative_to(SOURCES).parts) for folder in SOURCES.rglob("__init__.py")
        ),
        package_dir={"": "src"},
    ),
)
