"""A simulated session as files, with the config that runs on them: downstream cannot tell it from a recording."""

from pathlib import Path

from jaxgeo.data import Survey
from jaxgeo.io.atomic import output_folder, write_lines
from jaxgeo.io.sightings_csv import write_pose_sightings
from jaxgeo.io.tum import write_tum
from jaxgeo.io.yaml_text import dump_yaml
from jaxgeo.simulate.layout import ORIGIN_ENH_M
from jaxgeo.simulate.session import SimulatedSession
from jaxgeo.simulate.truth_file import truth_json


def write_session_files(session: SimulatedSession, folder: Path) -> Path:
    """Write survey, sightings, trajectories, truth and config into `folder`, all or nothing; the config's path."""
    with output_folder(folder) as temporary:
        write_survey(temporary / "survey.csv", session.survey)
        write_pose_sightings(temporary / "sightings.csv", session.sightings)
        for name, trajectory in session.trajectories.items():
            write_tum(temporary / f"{name}.tum", trajectory)
        write_tum(temporary / "truth.tum", session.truth)
        (temporary / "truth.json").write_text(truth_json(session), encoding="utf-8")
        (temporary / "config.yaml").write_text(dump_yaml(_config(session)), encoding="utf-8")
    return folder / "config.yaml"


def session_name(session: SimulatedSession) -> str:
    """The name that the session's config gives it."""
    return f"simulated_{session.layout.name.lower()}"


def write_survey(path: Path, survey: Survey) -> None:
    """Write a survey with one sigma a location, as `read_survey` takes it."""
    rows = zip(survey.name, survey.enh_m.tolist(), survey.sigma_m[:, 0].tolist(), strict=True)
    write_lines(path, ["name,N,E,h,sigma_m", *(f"{name},{n!r},{e!r},{h!r},{s!r}" for name, (e, n, h), s in rows)])


def _config(session: SimulatedSession) -> dict:
    """The whole session in a config; the truth is a reference only, nothing is estimated from it."""
    return {
        "name": session_name(session),
        "simulated": True,
        "seed": session.seed,
        "crs": session.survey.crs,
        "origin_enh_m": ORIGIN_ENH_M.tolist(),
        "survey": {"file": "survey.csv"},
        "sightings": {"kind": "poses", "file": "sightings.csv", "frame": "body"},
        "visits": {"gap_s": 5.0, "order": list(session.order)},
        "trajectories": {
            name: {
                "file": f"{name}.tum",
                "format": "tum",
                "odometry": "lidar",
                "reference": {"file": "truth.tum", "format": "tum", "frame": "local"},
            }
            for name in session.trajectories
        },
        "anchors": {"extra_sigma_m": session.visit_sigma_m},
    }
