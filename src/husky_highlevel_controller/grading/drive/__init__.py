"""One drive of a submission: network, simulator, recording, RViz."""
