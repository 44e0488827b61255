"""Holds out, repeats, tabulates, draws, places anchors."""
