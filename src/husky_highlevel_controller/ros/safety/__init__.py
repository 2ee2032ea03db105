"""The guard nodes proximity_stop and crash_stop."""
