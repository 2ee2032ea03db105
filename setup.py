"""Catkin reads this; do not call it by hand."""

from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

setup(
    **generate_distutils_setup(
        packages=["husky_highlevel_controller", "husky_highlevel_controller.nodes"],
        package_dir={"": "src"},
    )
)
