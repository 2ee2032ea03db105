"""Hand-ins: archives, packages, the launch file that is meant, the build."""
