"""Benchmarks: the solver against GTSAM, and every real session from end to end."""
