"""Pictures and pages of runs: what simulator, controller and their nodes may not import."""
