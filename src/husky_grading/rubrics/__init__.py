"""The rubrics of the exercises: recordings in, points out."""
