"""Drive of a submission: network, simulator, recording, RViz."""
