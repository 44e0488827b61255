"""What sound files may fail to determine."""

from cli.bad_input.case import bad, with_set
from cli.spoil import cell, on_a_line

ESTIMATE = [
    with_set(
        "two-locations",
        "poses",
        "visits.order=[A, B, A, B, A, B, A]",
        r"trajectories\.icp: the 7 anchors at 2 location\(s\) \(A, B\) do not fix the frame: the turn about the "
        r"direction \(E 0\.79, N -0\.61, h -0\.08\) is wholly free",
        "Three locations off one line are needed",
        code=3,
    ),
    with_set(
        "one-location",
        "poses",
        "visits.order=[A, A, A, A, A, A, A]",
        r"at 1 location\(s\) \(A\)",
        "visits.order",
        code=3,
    ),
    bad(
        "collinear",
        "truth",
        on_a_line,
        r"the turn about the direction \(E 1\.00, N -?0\.00, h -?0\.00\) is wholly",
        code=3,
    ),
    with_set(
        "one-step",
        "poses",
        "solver.max_steps=1",
        r"did not converge: too many steps after 1 of 1 steps \(solver\.max_steps\)",
        "visit 'A_revisit' is farthest off",
        code=3,
    ),
    bad(
        "anchor-a-kilometre-off",
        "poses",
        cell("survey.csv", 4, 1, "77821.262"),
        "did not converge",
        "visit 'C' is farthest off, by 697 m, the median visit by",
        "wrong anchors",
        code=3,
    ),
]
