"""RGB-D frames from files: folders, ROS bags."""
