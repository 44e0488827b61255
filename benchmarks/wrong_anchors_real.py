"""Real sessions as they are, and with the labels of two visits, or of two locations, exchanged by hand."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.wrong_anchors_simulated import Row, finding_row
from calibration.faults import find_fault, gate, relabelled, session_of, site_of
from calibration.faults import hypotheses as of
from jaxgeo.associate import make_anchors
from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.noise import learn_settings, noise_of
from jaxgeo.cli.session import settings_of
from jaxgeo.config import load_config

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
SESSIONS = (
    "kitti00",
    "tagslam_test11",
    "hilti2021_basement1_hdl",
    "hilti2021_basement1_svo2",
    "hilti2021_campus2_hdl",
    "hilti2021_campus2_svo2",
)


def real_rows(name: str, exchanges: int, seed: int) -> Iterator[Row]:
    """The session as it is, then `exchanges` of its exchanges, drawn without repeating; all where there are fewer."""
    config = load_config(CONFIGS / f"{name}.yaml")
    data = ingest(config)
    origin, settings = data.frame.origin_enh_m, settings_of(config)
    site = site_of(data.survey, origin)
    for trajectory_name, source in config.trajectories.items():
        trajectory = data.trajectories[trajectory_name]
        anchors, _ = make_anchors(trajectory, data.sightings, data.visits, data.survey, origin_enh_m=origin)
        learn = learn_settings(config, source, noise_of(source, config), None)
        told = anchors.location
        cases = [of.right(told), *_drawn(of.exchanged(told), exchanges, seed)]
        for h in cases:
            session = session_of(trajectory, relabelled(anchors, h.places, site), site, settings, learn)
            started = time.perf_counter()
            worth = gate(session, ordered=False).worth
            found = find_fault(session, ordered=False)
            truth = of.Hypothesis(h.kind, h.visits, told)
            yield (
                {"session": name, "trajectory": trajectory_name, "visits": len(told), "fault": h.kind}
                | finding_row(found, truth)
                | {"gate_worth": worth, "seconds": time.perf_counter() - started}
            )


def _drawn(hypotheses: list[of.Hypothesis], count: int, seed: int) -> list[of.Hypothesis]:
    if len(hypotheses) <= count:
        return hypotheses
    chosen = np.random.default_rng(seed).choice(len(hypotheses), count, replace=False)
    return [hypotheses[i] for i in sorted(chosen)]
