"""What can be wrong with sightings, rigs, visits and stops."""

from cli.bad_input.case import bad, with_set
from cli.spoil import cell, columns, later, lines, replace, row

SIGHTINGS = [
    bad(
        "nan-sighting", "poses", cell("sightings.csv", 4, 1, "nan"), r"sightings\.csv:4: column 'x' holds 'nan'", "mend"
    ),
    bad(
        "huge-sighting", "poses", cell("sightings.csv", 4, 1, "1e20"), r"sightings\.csv:4: coordinate 1e\+20 m", "units"
    ),
    bad(
        "other-epoch",
        "poses",
        later("sightings.csv", 1e9),
        r"trajectories\.icp: 21 of 21 sightings lie outside .*first at 1000000000\.400 s \(sightings\.csv:2\)",
        "clocks differ",
    ),
    bad(
        "late-clock",
        "poses",
        later("sightings.csv", 15.0),
        r"8 of 21 sightings lie outside .*\(sightings\.csv:15\); the trajectory runs from 0\.000 to 39\.800 s",
        "clocks are some seconds apart",
    ),
    with_set(
        "order-too-short",
        "poses",
        "visits.order=[A, B, C, D, E, F]",
        r"7 visits were found but visits\.order names 6",
        r"(?s)1: 0\.400 to 1\.600 s, 3 sightings.*7: 36\.400 to",
        r"Raise visits\.gap_s",
    ),
    with_set("order-too-long", "poses", "visits.order=[A, B, C, D, E, F, A, B]", "names 8", r"Lower visits\.gap_s"),
    with_set(
        "order-unknown", "poses", "visits.order=[A, B, C, D, E, G, A]", r"visits\.order names 'G'\. The survey has A"
    ),
    with_set("no-order", "poses", "visits.order=null", "7 of 7 visits have no decoded id", r"`visits\.order`"),
    with_set(
        "order-and-ids",
        "poses",
        "visits.locations={a: A}",
        r"poses\.yaml: visits: 'order' is for markers without ids",
        "remove",
    ),
    bad(
        "unknown-ids",
        "corners",
        columns("corners.csv", lambda c: c if c[0] == "stamp_s" else [c[0], c[1], f"9{c[2]}", *c[3:]]),
        "none of the 7 visits belongs to a surveyed location",
        r"'9A' \(6 in 2 visits\)",
        "The survey has A, B",
    ),
    with_set(
        "id-to-nowhere", "corners", "visits.locations={A: Z}", r"visits\.locations names 'Z'\. The survey has", "Mend"
    ),
    bad(
        "camera-not-in-rig",
        "corners",
        columns("corners.csv", lambda c: [c[0], c[1].replace("cam0", "left"), *c[2:]]),
        r"corners\.csv:2: camera 'left' is not in the rig, which has cam0",
        "camera_names",
    ),
    with_set("camera-twice", "corners", "sightings.camera=cam0", r"corners\.csv: .*has a camera column", "not both"),
    bad("no-rig", "corners", replace("corners.yaml", "rig: {file: rig.yaml}\n", ""), r"corners\.yaml: .*give 'rig'"),
    bad(
        "three-coefficients",
        "corners",
        replace("rig.yaml", "[0, 0, 0, 0]", "[0, 0, 0]"),
        r"rig\.yaml: cam0: distortion: 3 coefficients; radtan expects 4 or 5",
    ),
    bad(
        "rig-key",
        "corners",
        replace("rig.yaml", "resolution_px", "resolution"),
        r"rig\.yaml: cam0: unknown key 'resolution'",
    ),
    bad(
        "rig-rotation", "corners", replace("rig.yaml", "_wxyz: [", "_wxyz: [9"), r"rig\.yaml: cam0: quat_body_cam_wxyz"
    ),
    bad(
        "no-marker-size",
        "corners",
        replace("corners.yaml", ", marker_size_m: 0.3", ""),
        r"corners\.yaml: sightings: missing key 'marker_size_m': the side",
    ),
    with_set(
        "one-marker-size", "corners", "sightings.marker_size_m={A: 0.3}", "no marker size for id 'B'", "'default'"
    ),
    bad(
        "equal-corners",
        "corners",
        row("corners.csv", 4, lambda c: [*c[:3], *["100"] * 8]),
        r"corners\.csv:4: two of the four corners coincide; expected four different",
        "Remove the row",
    ),
    bad(
        "crossed-corners",
        "corners",
        row("corners.csv", 4, lambda c: [*c[:5], *c[7:9], *c[5:7], *c[9:]]),
        r"corners\.csv:4: the outline of the four corners crosses itself; expected",
    ),
    bad(
        "corners-off-image",
        "corners",
        columns("corners.csv", lambda c: c if c[0] == "stamp_s" else [*c[:3], *(str(float(x) + 5000) for x in c[3:])]),
        r"21 of 21 sightings have corners outside the image .*corners\.csv:2",
        "check intrinsics",
    ),
    bad(
        "stops-disagree",
        "stops",
        cell("stops.csv", 8, 2, "76845.0"),
        r"stops\.csv: location 'A' \(lines 2, 8\) spreads by 2\.936 m about its mean; expected at most 0\.05 m",
        "names right",
    ),
    bad(
        "stops-unsorted",
        "stops",
        lines("stops.csv", lambda o: [o[0], *o[:0:-1]]),
        r"stops\.csv:3: stamp 31\.0 lies before",
    ),
    bad(
        "too-few-names",
        "stops",
        columns("stops.csv", lambda c: [c[0], *c[2:]]),
        r"stops\.csv: 7 rows, but 2 names; expected a name for each",
        set_=("sightings.names=[A, B]",),
    ),
    with_set(
        "stops-and-survey", "stops", "survey={file: survey.csv}", r"stops\.yaml: .*'control_points' .*remove 'survey'"
    ),
    bad(
        "visit-beyond-truth",
        "truth",
        replace("truth.yaml", "row: 185}", "row: 1850}"),
        r"sightings\.visits: visit of 'A': row 1850 is not in the truth, which has rows 0 to 199",
    ),
    with_set(
        "wrong-separator", "poses", "sightings.delimiter=;", r"sightings\.csv: no column for stamp_s", "separator"
    ),
    with_set(
        "unknown-column", "poses", "sightings.columns={stamp: 0}", r"sightings\.csv: columns: unknown key 'stamp'"
    ),
    with_set(
        "column-beyond",
        "poses",
        "sightings.columns={stamp_s: 0, x: 1, y: 2, z: 33}",
        r"sightings\.csv: column index 33, but the table has 4 columns: expected 0 to 3",
    ),
]
