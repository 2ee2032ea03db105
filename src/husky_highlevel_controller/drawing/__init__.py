"""Pictures and pages of runs; simulator, controller and their nodes may not import them."""
