"""Functions that the judges of several exercises use: causes, markers, RViz, and items over all runs."""
