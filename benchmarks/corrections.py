"""Wrong clocks and lever arms, found again: `python -m benchmarks.corrections [--json] [--sessions N]`.

Simulated: a rig that passes markers, and the study's, which stands before them; offsets, arms and camera rotations are
drawn from their priors, and the intervals counted that hold the truth. Real: TagSLAM's test 11, its sightings' stamps
or its camera's place shifted by hand; the reference is what the unshifted recording itself gives. Held-out errors are
of noise and corrections learned in each fold, before and after.
"""

import dataclasses
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import typer
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from calibration.calibrate import LearnSettings
from calibration.corrections import CorrectionEstimate, estimate_corrections
from calibration.corrections_folds import hold_out_with_corrections
from calibration.corrections_words import corrections_of
from eval.loo import correct_and_hold_out, learn_and_hold_out
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.noise import learn_settings, noise_of, stored_noise
from jaxgeo.cli.session import settings_of
from jaxgeo.config import load_config
from jaxgeo.data import Sightings, Survey, Trajectory, Visit
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.precision import enable_compilation_cache
from jaxgeo.simulate.layout import ORIGIN_ENH_M, UAV, Layout
from jaxgeo.simulate.session import DENSE_DRIFT, VISIT_SIGMA_M, simulate_session
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.corrections import ARM, CORRECTIONS, ROTATION, TIME, CorrectionPrior

ROOT = Path(__file__).resolve().parents[1]
PRIOR = CorrectionPrior(time_offset_s=0.1, lever_arm_m=0.05, rotation_rad=0.02)
# Walked past at about 1 m/s without a stop, each marker in view for four seconds.
PASSING = Layout(
    name="passing",
    counts=(80,) * 7,
    repeatability_m=(0.02,) * 7,
    duration_s=80.0,
    n_poses=1600,
    rig_height_m=1.0,
    image_rate_hz=20.0,
    stream=7,
)
PASSING_VISIT_SIGMA_M = 0.01
NAME = "dense"
# A shorter pause than any that parts two visits of the moved marker.
GAP_S = 1.5
OFFSETS_S = (-0.2, -0.1, 0.0, 0.1, 0.2)
ARMS_M = ((0.05, 0.0, 0.0), (-0.1, 0.0, 0.0), (0.0, 0.0, 0.05), (0.0, 0.0, -0.1), (0.07, 0.0, 0.07))
# Truths of simulated sessions are drawn apart from everything that the sessions draw.
TRUTH_STREAM = 71
_SIGMA_95 = 1.96


@dataclasses.dataclass(frozen=True)
class Case:
    """One session's data as the estimator is given them."""

    trajectory: Trajectory
    sightings: Sightings
    visits: list[Visit]
    survey: Survey
    origin_enh_m: Float[np.ndarray, "3"]
    settings: Settings
    learn: LearnSettings

    def shifted(self, wrong: Float[np.ndarray, "7"]) -> "Case":
        """The same recorded by a rig that needs the corrections `wrong` more: what `corrected_sightings` undoes."""
        turn = Rotation.from_rotvec(wrong[ROTATION]).inv()
        sightings = dataclasses.replace(
            self.sightings,
            stamp_s=self.sightings.stamp_s - wrong[TIME],
            t_body_marker_m=turn.apply(self.sightings.t_body_marker_m - wrong[ARM]),
        )
        visits = [
            dataclasses.replace(v, start_s=v.start_s - wrong[TIME], end_s=v.end_s - wrong[TIME]) for v in self.visits
        ]
        return dataclasses.replace(self, sightings=sightings, visits=visits)

    def estimate(self) -> CorrectionEstimate:
        return estimate_corrections(
            self.trajectory,
            self.sightings,
            self.visits,
            self.survey,
            origin_enh_m=self.origin_enh_m,
            settings=self.settings,
            learn=self.learn,
            prior=PRIOR,
        )

    def held_out_m(self) -> tuple[float, float]:
        """Mean held-out error with learned noise, as recorded and with corrections."""
        anchors, _ = make_anchors(
            self.trajectory, self.sightings, self.visits, self.survey, origin_enh_m=self.origin_enh_m
        )
        _, fixed = correct_and_hold_out(self.trajectory, anchors, self.learn.noise, self.settings)
        _, _, before = learn_and_hold_out(self.trajectory, anchors, self.settings, self.learn, fixed)
        assert before is not None
        after = hold_out_with_corrections(
            self.trajectory,
            self.sightings,
            self.visits,
            self.survey,
            origin_enh_m=self.origin_enh_m,
            settings=self.settings,
            learn=self.learn,
            prior=PRIOR,
        )
        return mean_length_m(before.refined.error_enh_m), mean_length_m(after.error_m)


def mean_length_m(error_m: Float[np.ndarray, "k 3"]) -> float:
    return float(np.nanmean(np.linalg.norm(error_m, axis=1)))


def simulated(layout: Layout, seed: int) -> Case:
    visit_sigma_m = PASSING_VISIT_SIGMA_M if layout is PASSING else VISIT_SIGMA_M
    session = simulate_session(seed, layout, drift={NAME: DENSE_DRIFT}, visit_sigma_m=visit_sigma_m)
    visits, _ = label_visits(cut_visits(session.sightings, GAP_S), session.survey, order=session.order)
    learn = LearnSettings("lidar", default_noise("lidar"))
    return Case(session.trajectories[NAME], session.sightings, visits, session.survey, ORIGIN_ENH_M, Settings(), learn)


def tagslam() -> Case:
    config = load_config(ROOT / "configs" / "tagslam_test11.yaml", [])
    data = ingest(config)
    source = config.trajectories["vio"]
    learn = learn_settings(config, source, noise_of(source, config), stored_noise(config, source))
    origin = np.asarray(data.frame.origin_enh_m)
    trajectory = data.trajectories["vio"]
    return Case(trajectory, data.sightings, data.visits, data.survey, origin, settings_of(config), learn)


def row_of(kind: str, case: str, truth: Float[np.ndarray, "7"], found: CorrectionEstimate) -> dict[str, Any]:
    """Every correction's truth, estimate, standard deviation, and whether it was observable and inside its interval."""
    rows = {each.name: each for each in corrections_of(found).rows}
    inside = np.abs(found.value - truth) < _SIGMA_95 * found.sigma
    return {
        "kind": kind,
        "case": case,
        "truth": truth.round(5).tolist(),
        "estimate": found.value.round(5).tolist(),
        "sigma": found.sigma.round(5).tolist(),
        "observable": [rows[name].observable for name in CORRECTIONS],
        "inside_95": inside.tolist(),
        "rounds": found.rounds,
    }


def simulated_rows(sessions: int) -> Iterator[dict[str, Any]]:
    for name, layout in (("passing", PASSING), ("standing", UAV)):
        for seed in range(sessions):
            draw = np.random.default_rng(np.random.SeedSequence([TRUTH_STREAM, seed, layout.stream]))
            truth = PRIOR.sigma * draw.standard_normal(len(CORRECTIONS))
            yield row_of(f"{name}, drawn", f"seed {seed}", truth, simulated(layout, seed).shifted(truth).estimate())
        for seed in range(min(sessions, 10)):
            for offset_s in (-0.2, 0.2):
                truth = np.array([offset_s, *[0.0] * 6])
                found = simulated(layout, seed).shifted(truth).estimate()
                yield row_of(f"{name}, clock", f"seed {seed}, {offset_s:+.1f} s", truth, found)


def tagslam_rows(case: Case) -> Iterator[dict[str, Any]]:
    """The truth is what the unshifted recording gives, plus the shift."""
    own = case.estimate()
    for offset_s in OFFSETS_S:
        wrong = np.array([offset_s, *[0.0] * 6])
        found = own if offset_s == 0.0 else case.shifted(wrong).estimate()
        yield row_of("TagSLAM, clock", f"{offset_s:+.1f} s", own.value + wrong, found)
    for arm_m in ARMS_M:
        wrong = np.array([0.0, *arm_m, 0.0, 0.0, 0.0])
        label = ", ".join(f"{100 * a:+.0f}" for a in arm_m) + " cm"
        yield row_of("TagSLAM, arm", label, own.value + wrong, case.shifted(wrong).estimate())


def held_out_rows(real: Case | None) -> Iterator[dict[str, Any]]:
    for seed in range(5):
        for offset_s in (0.0, 0.2):
            wrong = np.array([offset_s, *[0.0] * 6])
            before_m, after_m = simulated(PASSING, seed).shifted(wrong).held_out_m()
            case = f"passing, seed {seed}, {offset_s:+.1f} s"
            yield {"kind": "held out", "case": case, "before_m": before_m, "after_m": after_m}
    for offset_s in (0.0, 0.2) if real is not None else ():
        assert real is not None
        before_m, after_m = real.shifted(np.array([offset_s, *[0.0] * 6])).held_out_m()
        yield {"kind": "held out", "case": f"TagSLAM, {offset_s:+.1f} s", "before_m": before_m, "after_m": after_m}


def summary_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """`offset_error_ms`: the largest over all cases in which the clock is said to be observable; coverage by kind."""
    estimated = [row for row in rows if "estimate" in row]
    seen = [row for row in estimated if row["observable"][TIME] == "yes"]
    error_ms = [1e3 * abs(row["estimate"][TIME] - row["truth"][TIME]) for row in seen]
    drawn = {kind: [row for row in estimated if row["kind"] == kind] for kind in ("passing, drawn", "standing, drawn")}
    return {
        "offset_error_ms": max(error_ms, default=None),
        "offset_error_rms_ms": float(np.sqrt(np.mean(np.square(error_ms)))) if error_ms else None,
        "offset_observable": len(seen),
        "cases": len(estimated),
        "coverage_95": {
            kind: dict(zip(CORRECTIONS, np.mean([row["inside_95"] for row in some], axis=0).tolist(), strict=True))
            for kind, some in drawn.items()
            if some
        },
    }


def measured(sessions: int, held_out: bool = True) -> dict[str, Any]:
    """`summary_of` all cases, and the cases: `sessions` simulated ones of each kind, and TagSLAM's where it lies."""
    rows = list(simulated_rows(sessions))
    real = tagslam() if (Path(os.environ["JAXGEO_DATA"]) / "tagslam").is_dir() else None
    if real is not None:
        rows += tagslam_rows(real)
    if held_out:
        rows += held_out_rows(real)
    return {**summary_of(rows), "rows": rows}


def print_table(result: dict[str, Any]) -> None:
    for row in result["rows"]:
        if "before_m" in row:
            print(f"{row['kind']:18} {row['case']:28} {row['before_m']:.3f} m -> {row['after_m']:.3f} m")
            continue
        pairs = zip(row["truth"], row["estimate"], row["sigma"], row["observable"], strict=True)
        cells = "  ".join(f"{t:+.3f} {e:+.3f}±{s:.3f}{o[0]}" for t, e, s, o in pairs)
        print(f"{row['kind']:18} {row['case']:18} {cells}", flush=True)
    print(json.dumps({key: value for key, value in result.items() if key != "rows"}, indent=1))


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object, every case a row."),
    sessions: int = typer.Option(100, "--sessions", min=1, help="Simulated sessions of each kind."),
    held_out: bool = typer.Option(True, help="Also hold locations out."),
) -> None:
    os.environ.setdefault("JAXGEO_DATA", str(ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    result = measured(sessions, held_out)
    if as_json:
        print(json.dumps(result, allow_nan=False))
    else:
        print_table(result)


if __name__ == "__main__":
    typer.run(main)
