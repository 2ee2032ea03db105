"""PyBullet behind typed methods; the only folder that imports pybullet."""
