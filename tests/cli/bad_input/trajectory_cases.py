"""What can be wrong with the poses, their stamps and the reference."""

from cli.bad_input.case import bad, with_set
from cli.spoil import cell, content, lines, nothing, replace, row

TRAJECTORY = [
    bad(
        "nan", "poses", cell("icp.tum", 12, 2, "nan"), r"icp\.tum:12: column 2 .* holds 'nan'; expected", "mend the row"
    ),
    bad("nan-kitti", "truth", cell("icp.kitti", 12, 2, "nan"), r"icp\.kitti:12: column 2 .*'nan'", "mend the row"),
    bad("infinite", "poses", cell("icp.tum", 12, 2, "-inf"), r"icp\.tum:12: .* holds '-inf'; expected a finite number"),
    bad(
        "overflow", "poses", cell("icp.tum", 12, 2, "1e999"), r"icp\.tum:12: .* holds '1e999'; expected a finite number"
    ),
    bad(
        "huge", "poses", cell("icp.tum", 12, 2, "1e30"), r"icp\.tum:12: coordinate 1e\+30 m is beyond 1e\+08 m", "units"
    ),
    bad(
        "words", "poses", cell("icp.tum", 12, 2, "north"), r"icp\.tum:12: column 2 .* holds 'north'; expected a number"
    ),
    bad("decimal-comma", "poses", cell("icp.tum", 12, 2, "1,5"), r"icp\.tum:12: .*'1,5'; .*write a decimal point"),
    bad(
        "unsorted",
        "poses",
        lines("icp.tum", lambda old: [*old[:10], old[11], old[10], *old[12:]]),
        r"icp\.tum:12: stamp 2\.0 lies before 2\.2 of line 11; expected strictly increasing",
        "Sort the rows",
    ),
    bad(
        "repeated-stamp",
        "poses",
        lines("icp.tum", lambda old: [*old[:10], *old[9:]]),
        r"icp\.tum:11: stamp 1\.8 repeats that of line 10; expected strictly increasing",
        "Keep one",
    ),
    bad(
        "nanoseconds",
        "poses",
        cell("icp.tum", 200, 0, "1700000000000000000"),
        r"icp\.tum:200: stamp 1\.7e\+18 is not in seconds",
        "Divide the stamps by 1e9",
    ),
    bad(
        "long-quaternion",
        "poses",
        row("icp.tum", 3, lambda c: [*c[:4], *(str(2 * float(x)) for x in c[4:])]),
        r"icp\.tum:3: the quaternion has norm 2, expected 1",
        "another order",
    ),
    bad(
        "zero-quaternion",
        "poses",
        row("icp.tum", 3, lambda c: [*c[:4], "0", "0", "0", "0"]),
        r"icp\.tum:3: the quaternion is zero; expected unit length",
        "remove the row",
    ),
    bad(
        "one-pose",
        "poses",
        lines("icp.tum", lambda old: old[:1]),
        r"icp\.tum: 1 pose\(s\), expected at least 2",
        "complete",
    ),
    bad(
        "comments", "poses", content("icp.tum", "# stamp x y z\n"), r"icp\.tum: no data rows, only comments", "complete"
    ),
    bad(
        "more-columns",
        "poses",
        row("icp.tum", 7, lambda cells: [*cells, "1"]),
        r"icp\.tum:7: 9 columns, expected 8 as in line 1",
        "remove the row",
    ),
    bad(
        "scaled-kitti",
        "truth",
        row("icp.kitti", 3, lambda cells: [str(2 * float(x)) for x in cells]),
        r"icp\.kitti:3: R R\^T is off the identity by 3, expected",
        "without a scale",
    ),
    bad(
        "other-times",
        "truth",
        lines("times.txt", lambda old: old[:150]),
        r"icp\.kitti has 200 poses, but .*times\.txt has 150 stamps; expected one stamp for each",
        "another run",
    ),
    bad(
        "times-backwards",
        "truth",
        lines("times.txt", lambda old: old[::-1]),
        r"times\.txt:2: stamp 39\.6 lies before 39\.8",
    ),
    bad(
        "no-times",
        "truth",
        replace("truth.yaml", "times: times.txt, ", ""),
        r"truth\.yaml: trajectories\.icp: format 'kitti' has no stamps: give exactly one of 'times' and 'rate_hz'",
    ),
    with_set("times-and-rate", "truth", "trajectories.icp.rate_hz=5", r"trajectories\.icp: .*exactly one .*has both"),
    with_set(
        "not-euroc", "poses", "trajectories.icp.format=euroc", r"icp\.tum:1: successive stamps differ by 0\.2", "tum"
    ),
    bad(
        "not-g2o",
        "poses",
        nothing,
        r"icp\.tum: no VERTEX_SE3:QUAT record; found",
        "another one",
        set_=("trajectories.icp.format=g2o", "trajectories.icp.rate_hz=5"),
    ),
    bad(
        "reference-elsewhere",
        "poses",
        content("reference.tum", "1e9 0 0 0 0 0 0 1\n1000000001 1 0 0 0 0 0 1\n"),
        r"trajectories\.icp: the reference .* covers 0 stamps of the trajectory",
        "clocks|wrong reference",
        set_=("trajectories.icp.reference={file: reference.tum, format: tum}",),
    ),
]
