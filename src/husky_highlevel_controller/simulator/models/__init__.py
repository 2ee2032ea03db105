"""Robot and world descriptions: xacro, URDF and SDF."""
