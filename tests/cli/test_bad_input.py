"""Bad input through the command line: the exit code, one message that names place and mend, and nothing written."""

import dataclasses
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from cli.small_session import write_small_session
from cli.spoil import (
    BOMB,
    JUNK,
    Spoil,
    cell,
    columns,
    content,
    folder_instead,
    later,
    lines,
    missing,
    nothing,
    on_a_line,
    replace,
    row,
)

import jaxgeo.io.atomic
from jaxgeo.cli.main import TERMINATED, main


@dataclasses.dataclass(frozen=True)
class Case:
    """`session` names the config, `says` is what the message must match, `set_` what --set is given."""

    id: str
    session: str
    spoil: Spoil
    code: int
    says: tuple[str, ...]
    set_: tuple[str, ...] = ()


def bad(id: str, session: str, spoil: Spoil, *says: str, code: int = 2, set_: tuple[str, ...] = ()) -> Case:
    return Case(id, session, spoil, code, says, set_)


def with_set(id: str, session: str, override: str, *says: str, code: int = 2) -> Case:
    return Case(id, session, nothing, code, says, (override,))


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

CONFIG = [
    with_set(
        "unknown-key", "poses", "coarse.scal=true", r"poses\.yaml: coarse: unknown key 'scal'; did you mean 'scale'\?"
    ),
    with_set("wrong-type", "poses", "coarse.scale=3", r"poses\.yaml: coarse\.scale: found 3; expected true or false"),
    with_set("negative-gap", "poses", "visits.gap_s=-1", r"poses\.yaml: visits\.gap_s: found -1; .*greater than 0"),
    with_set("nan-in-config", "poses", "anchors.extra_sigma_m=.nan", r"anchors\.extra_sigma_m: found nan; .*finite"),
    with_set("set-without-value", "poses", "coarse.scale", "--set coarse.scale: expected key=value"),
    with_set("set-below-a-text", "poses", "name.x=3", "--set name.x=3: name is 'small', which has no keys"),
    with_set("set-not-yaml", "poses", "survey=[", r"--set survey=\[: the value is not YAML: line 1, column 2"),
    with_set(
        "data-unset", "poses", "survey.file=${JAXGEO_DATA}/x.csv", r"survey\.file: .*JAXGEO_DATA is not set: set it"
    ),
    with_set("no-trajectory", "poses", "trajectories={}", r"poses\.yaml: trajectories: expected at least one entry"),
    with_set(
        "rotation-unused", "poses", "anchors.use_rotation=true", r"anchors\.use_rotation is on, but none", "false"
    ),
    bad(
        "key-twice",
        "poses",
        replace("poses.yaml", "crs: EPSG:2169", "crs: EPSG:2169\ncrs: local"),
        r"poses\.yaml: line 3, column 1: the key 'crs' stands twice",
    ),
    bad("yaml-bomb", "poses", content("poses.yaml", BOMB), r"poses\.yaml: line 3, column \d+: more than 10 aliases"),
    bad(
        "yaml-tab",
        "poses",
        replace("poses.yaml", "    file: icp", "\tfile: icp"),
        r"poses\.yaml: line \d+, column 1: .*'\\t'",
    ),
    bad("yaml-code", "poses", content("poses.yaml", "a: !!python/none x\n"), "line 1, column 4: the tag .* remove it"),
    bad("yaml-list", "poses", content("poses.yaml", "- a\n"), r"poses\.yaml: holds list; expected a mapping"),
]

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

CASES = [*every_file(), *TRAJECTORY, *SURVEY, *SIGHTINGS, *CONFIG, *ESTIMATE]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    write_small_session(folder)
    return folder


@pytest.fixture
def session(sound, tmp_path, monkeypatch):
    """The small session's files, to be spoilt."""
    monkeypatch.delenv("JAXGEO_DATA", raising=False)
    # The folder of compiled programs that the whole suite uses.
    monkeypatch.setenv("JAXGEO_CACHE", jax.config.jax_compilation_cache_dir)
    return Path(shutil.copytree(sound, tmp_path / "session"))


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Every file's bytes and every folder, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def run(session: Path, name: str = "poses", *overrides: str, out: str = "out") -> int:
    options = [word for override in overrides for word in ("--set", override)]
    return main(["run", str(session / f"{name}.yaml"), "--out", str(session / out), "--quiet", *options])


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_one_message_and_writes_nothing(case, session, capsys):
    case.spoil(session)
    before = snapshot(session)
    assert run(session, case.session, *case.set_) == case.code
    out, message = capsys.readouterr()
    assert out == ""
    assert message.startswith("error: ")
    assert message.count("error: ") == 1
    assert "Traceback" not in message
    for pattern in case.says:
        assert re.search(pattern, message), f"{pattern!r} is not in {message!r}"
    assert snapshot(session) == before


def test_the_cases_are_many_and_their_names_are_unique():
    assert len({case.id for case in CASES}) == len(CASES) > 100


@pytest.fixture
def metrics(session, capsys):
    """The figures of a run that goes well."""

    def read(name: str = "poses", *overrides: str) -> dict:
        assert run(session, name, *overrides) == 0, capsys.readouterr().err
        return json.loads((session / "out" / "metrics.json").read_text())["trajectories"]["icp"]

    return read


@pytest.mark.parametrize("name", ["poses", "corners", "stops", "truth"])
def test_the_sound_session_runs(metrics, name):
    assert metrics(name)["coarse"]["rms_m"] == pytest.approx(0.041, abs=0.001)


def test_columns_are_read_by_name_in_any_order(session, metrics):
    given = metrics()
    columns("survey.csv", lambda c: [c[0], c[2], c[1], *c[3:]])(session)
    assert (session / "survey.csv").read_text().startswith("name,E,N,h")
    swapped = metrics()
    del given["timing_s"], swapped["timing_s"]
    assert swapped == given


def test_an_origin_off_the_site_changes_nothing(metrics):
    given, far = metrics(), metrics("poses", "origin_enh_m=[0, 0, 0]")
    assert far["coarse"]["rms_m"] == pytest.approx(given["coarse"]["rms_m"], abs=1e-9)


def test_a_rounded_trajectory_runs_with_a_warning(session, capsys):
    """Four decimals, quaternions too, as KISS-ICP writes."""
    lines("icp.tum", lambda old: [" ".join(f"{float(x):.4f}" for x in line.split()) for line in old])(session)
    assert main(["run", str(session / "poses.yaml"), "--out", str(session / "out")]) == 0
    warning = r"warning: icp: .*icp\.tum: quaternion norms are off by up to .*: the file was written with few decimals"
    assert re.search(warning, capsys.readouterr().err)
    assert "few decimals" in (session / "out" / "report.html").read_text()


def test_a_flat_survey_with_exchanged_axes_warns_that_the_trajectory_stands_on_its_head(session, capsys):
    columns("survey.csv", lambda c: c if c[0] == "name" else [*c[:3], "340", c[4]])(session)
    replace("survey.csv", "name,N,E", "name,E,N")(session)
    assert main(["run", str(session / "poses.yaml"), "--out", str(session / "out")]) == 0
    assert "z axis points down in the grid" in capsys.readouterr().err


def test_exchanged_axes_on_flat_ground_are_refused_where_up_is_known(session, capsys):
    columns("survey.csv", lambda c: c if c[0] == "name" else [*c[:3], "340", c[4]])(session)
    replace("survey.csv", "name,N,E", "name,E,N")(session)
    assert run(session, "poses", "coarse.gravity=true") == 2
    assert "E and N seem to be exchanged" in capsys.readouterr().err


@pytest.mark.parametrize("id", ["empty-icp.tum", "one-step", "collinear"])
def test_a_failing_run_leaves_an_older_result_as_it_was(session, metrics, id):
    metrics()
    case = next(case for case in CASES if case.id == id)
    case.spoil(session)
    before = snapshot(session)
    assert run(session, case.session, *case.set_) == case.code
    assert snapshot(session) == before


@pytest.mark.parametrize("out", ["survey.csv", "survey.csv/out", "survey.csv/a/b"])
def test_an_output_folder_that_cannot_be_is_refused_before_the_work(session, capsys, monkeypatch, out):
    monkeypatch.setitem(sys.modules, "jaxgeo.cli.session", None)  # to import it would fail
    before = snapshot(session)
    assert run(session, out=out) == 2
    message = capsys.readouterr().err
    assert re.search(r"^error: .*survey\.csv.*is a file, expected a folder .*Name another", message)
    assert snapshot(session) == before


def test_a_folder_in_the_place_of_an_output_leaves_the_older_result_whole(session, metrics, capsys):
    metrics()
    (session / "out" / "report.html").unlink()
    (session / "out" / "report.html").mkdir()
    before = snapshot(session)
    assert run(session) == 2
    assert re.search(r"error: .*report\.html: is a folder", capsys.readouterr().err)
    assert snapshot(session) == before


def test_a_full_disk_leaves_the_older_result_whole(session, metrics, capsys, monkeypatch):
    metrics()
    before = snapshot(session)
    real = Path.write_text

    def write_text(path, *args, **kwargs):
        if path.name == "report.html":
            raise OSError(28, "No space left on device", str(path))
        return real(path, *args, **kwargs)

    monkeypatch.setattr(Path, "write_text", write_text)
    assert run(session) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert snapshot(session) == before


@pytest.mark.parametrize(("signal_", "code"), [(signal.SIGTERM, TERMINATED), (signal.SIGINT, 130)])
def test_a_signal_while_files_are_written_leaves_nothing(session, capsys, monkeypatch, signal_, code):
    monkeypatch.setattr(jaxgeo.io.atomic, "_umask", lambda: signal.raise_signal(signal_) or 0)
    before = snapshot(session)
    assert run(session) == code
    assert capsys.readouterr().err in ("error: terminated\n", "error: interrupted\n")
    assert snapshot(session) == before


def test_a_signal_while_files_are_put_in_place_waits_until_all_are(session, metrics, monkeypatch):
    metrics()
    (session / "out" / "metrics.json").write_text("old")
    (session / "out" / "report.html").write_text("old")
    real = os.replace

    def replace_and_signal(old, new):
        signal.raise_signal(signal.SIGTERM)
        real(old, new)

    monkeypatch.setattr(os, "replace", replace_and_signal)
    assert run(session) == TERMINATED
    written = {name: data for name, data in snapshot(session).items() if name.startswith(("out", ".out"))}
    assert b"old" not in written.values()
    assert not [name for name in written if name.startswith(".out")]


def test_sigterm_ends_a_running_process_cleanly(session):
    before = snapshot(session)
    command = [
        sys.executable,
        "-m",
        "jaxgeo.cli.main",
        "run",
        str(session / "poses.yaml"),
        "--out",
        str(session / "out"),
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        first = process.stderr.readline()  # the first phase is done
        process.send_signal(signal.SIGTERM)
        rest = process.stderr.read()
        code = process.wait(timeout=60)
    assert first.startswith("read small")
    assert (code, rest.splitlines()[-1]) == (TERMINATED, "error: terminated")
    assert snapshot(session) == before
