"""Two controllers on the same scenes: in process, or launched through the marking's drive."""
