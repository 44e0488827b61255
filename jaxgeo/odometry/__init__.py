"""Trajectories from LiDAR scans alone: frame-to-model registration, without loop closure."""
