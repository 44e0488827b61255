"""RTAB-Map: its database, and the poses that it exports."""
