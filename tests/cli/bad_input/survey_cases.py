"""What can be wrong with the surveyed points and their coordinate system."""

from cli.bad_input.case import bad, with_set
from cli.spoil import cell, columns, lines, nothing, replace

SURVEY = [
    bad(
        "mirrored-by-header",
        "poses",
        replace("survey.csv", "name,N,E", "name,E,N"),
        r"E and N seem to be exchanged: with them swapped the 7 visits fit .* 0\.04\d m RMS, as given .* 0\.30\d m",
        "header of the survey",
    ),
    bad(
        "no-header",
        "poses",
        lines("survey.csv", lambda old: old[1:]),
        r"survey\.csv: no header line names the 5 columns",
        r"columns: \{name: 0",
    ),
    bad(
        "x-and-y",
        "poses",
        replace("survey.csv", "N,E", "x,y"),
        r"survey\.csv: columns x, y do not tell",
        "name them N and E",
    ),
    bad(
        "two-northings",
        "poses",
        replace("survey.csv", "N,E", "N,northing"),
        r"survey\.csv: N is given twice",
        "Keep one",
    ),
    bad(
        "no-heights",
        "poses",
        columns("survey.csv", lambda cells: [*cells[:3], *cells[4:]]),
        r"survey\.csv:2: location 'A' has 2 coordinate\(s\) \(E, N\); expected N, E, h",
        "set `height_m`",
    ),
    bad(
        "same-name-twice",
        "poses",
        cell("survey.csv", 4, 0, "A"),
        r"survey\.csv:4: location 'A' is already given at .*survey\.csv:2",
        "rename",
    ),
    bad(
        "negative-sigma",
        "poses",
        cell("survey.csv", 4, 4, "-0.01"),
        r"survey\.csv:4: location 'C' .* -0\.01 m; expected",
    ),
    bad(
        "nan-survey",
        "poses",
        cell("survey.csv", 4, 1, "nan"),
        r"survey\.csv:4: location 'C' has 2 coord",
        "Add the missing",
    ),
    bad(
        "huge-survey",
        "poses",
        cell("survey.csv", 4, 1, "1e12"),
        r"survey\.csv:4: location 'C' .* 1e\+12 m, beyond",
        "units",
    ),
    bad(
        "millimetres",
        "poses",
        cell("survey.csv", 4, 1, "76821262"),
        r"survey\.csv: location 'C': .* lies 3261 km outside the area of EPSG:2169",
        "unit",
    ),
    bad(
        "no-crs", "poses", replace("poses.yaml", "crs: EPSG:2169\n", ""), r"poses\.yaml: missing key 'crs': .*EPSG:2169"
    ),
    with_set("unknown-epsg", "poses", "crs=EPSG:999999", "crs 'EPSG:999999' is not in the EPSG register", "Examples"),
    with_set(
        "geographic-crs", "poses", "crs=EPSG:4326", "crs 'EPSG:4326' is 'WGS 84', .*expected a projected", "Project"
    ),
    with_set("feet", "poses", "crs=EPSG:2263", "crs 'EPSG:2263': .* US survey foot; expected metres", "Convert"),
    with_set("crs-by-name", "poses", "crs=LUREF", r"poses\.yaml: crs: found 'LUREF'; expected EPSG:<code>"),
    bad(
        "two-surveys",
        "poses",
        nothing,
        r"poses\.yaml: survey: give exactly one of file, points, .*found file and points",
        set_=("survey.points={A: {N: 1, E: 2, h: 3}}",),
    ),
    with_set("2-d-points", "poses", "survey={points: {A: {N: 1, E: 2}}}", "survey: point 'A' has no h", "height_m"),
    with_set(
        "all-ignored", "poses", "survey.ignore=[A, B, C, D, E, F]", r"survey\.csv:2: .*no locations left after `ignore`"
    ),
    bad(
        "row-beyond-truth",
        "truth",
        replace("truth.yaml", "F: 155}", "F: 1550}"),
        r"survey\.from_trajectory\.rows: location 'F': row 1550 is not in the truth, which has rows 0 to 199",
        "counted from 0",
    ),
]
