"""A simulated Clearpath Husky, and the controller that drives it to the pillar."""

from __future__ import annotations

from pkgutil import extend_path

# catkin's devel space has this package's messages in another folder. Whichever package of this repository a
# program imports first, that folder is found: the devel space itself sees to it only if it is this one
__path__ = extend_path(__path__, __name__)
