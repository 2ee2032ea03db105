"""A simulated Clearpath Husky, and the controller that drives it to the pillar."""
