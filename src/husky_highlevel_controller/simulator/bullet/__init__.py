"""PyBullet in this package's words; the only folder that imports pybullet."""
