"""A simulated Clearpath Husky, and the controller that drives it to the pillar."""

from __future__ import annotations

from pkgutil import extend_path

# In catkin's devel space, the message classes of this package are in another folder than its modules.
# `extend_path` makes Python look in both folders.
__path__ = extend_path(__path__, __name__)
