"""LiDAR scans from files: folders, packed arrays, ROS bags."""
