"""Learns the noise of one trajectory from its own anchors and revisits."""
