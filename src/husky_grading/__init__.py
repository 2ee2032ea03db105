"""Grader of submissions, which it drives. It starts simulator and submission, and imports neither."""
