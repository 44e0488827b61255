"""Every reader against damaged files: one table of targets, for the tests (hypothesis) and for long runs (atheris)."""
