"""Where to put anchors: the accuracy that a layout will give, and layouts that make it good."""
