"""The Monte-Carlo study: what learned odometry noise is worth over many simulated sessions whose noise is known."""
