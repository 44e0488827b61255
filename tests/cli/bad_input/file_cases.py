"""What can be wrong with a file of any kind."""

import re

from cli.bad_input.case import Case, bad
from cli.spoil import JUNK, content, folder_instead, lines, missing, row

FILES = {
    "poses.yaml": "poses",
    "survey.csv": "poses",
    "sightings.csv": "poses",
    "icp.tum": "poses",
    "corners.csv": "corners",
    "rig.yaml": "corners",
    "stops.csv": "stops",
    "truth.tum": "truth",
    "icp.kitti": "truth",
    "times.txt": "truth",
}
TABLES = ("survey.csv", "sightings.csv", "corners.csv", "stops.csv")


def every_file() -> list[Case]:
    """What can be wrong with a file of any kind."""
    cases = []
    for file, session in FILES.items():
        name = re.escape(file)
        cases += [
            bad(
                f"empty-{file}",
                session,
                content(file, ""),
                rf"{name}: (the file is empty|holds nothing)",
                "expected|Make",
            ),
            bad(f"junk-{file}", session, content(file, JUNK), rf"{name}:.* byte .* is not UTF-8 text"),
            bad(f"missing-{file}", session, missing(file), rf"(?i){name}: .*no such file"),
            bad(f"folder-{file}", session, folder_instead(file), rf"{name}: .*(a folder, expected|a directory)"),
        ]
    for file in TABLES:
        session, name = FILES[file], re.escape(file)
        cases += [
            bad(
                f"header-only-{file}",
                session,
                lines(file, lambda old: old[:1]),
                rf"{name}:2: a header \('.*'\) but no data rows\. Is",
            ),
            bad(
                f"a-column-less-{file}",
                session,
                row(file, 4, lambda cells: cells[:-1]),
                rf"{name}:4: \d+ columns, expected \d+ as in line 2",
                "Complete or remove the row",
            ),
        ]
    return cases
