"""Dense mapping: keyframes, loop closures, the loop-closed trajectory, fusion, and clouds carried with a correction."""
