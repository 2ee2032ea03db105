"""Nodes that record and exercise a submission while it is graded."""
