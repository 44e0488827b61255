"""Simulated sensors: a campus, the scans and RGB-D frames that a rig takes of it, and its files."""
