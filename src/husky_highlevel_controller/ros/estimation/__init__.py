"""The node of the planar filter, and the program plot_path."""
