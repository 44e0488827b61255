"""One table a file, each from the evaluations of any number of trajectories and sessions."""
