"""Warnings about input that is usable but worse than it should be."""


class InputWarning(UserWarning):
    """Something in a file is odd; it was read all the same."""


class RoundedInputWarning(InputWarning):
    """Rotations were written with few decimals, and were brought back to unit length."""
