"""`jaxgeo replay`: a recorded session through the online estimator, beside the batch answer."""

import gc
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxgeo.cli.progress import Progress
from jaxgeo.cli.run import keep_compiled_programs
from jaxgeo.config import load_config
from jaxgeo.config.inputs import (
    AnyTrajectoryInput,
    ControlPointSightingsInput,
    FromTrajectorySightingsInput,
)
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import ConfigError
from jaxgeo.io.atomic import check_output_folder

ONLINE_FILE, REPLAY_FILE = "online.csv", "replay.json"
COLUMNS = (
    *("stamp_s", "E_m", "N_m", "h_m", "qw", "qx", "qy", "qz"),
    *("sigma_E_m", "sigma_N_m", "sigma_h_m", "sigma_rE_rad", "sigma_rN_rad", "sigma_rh_rad"),
    *("n_anchors", "anchor_age_s", "status"),
)
# Sightings that are visits already (control points, rows of a truth) are parted by any pause at all.
_ANY_PAUSE_S = 1e-9


def replay_config(path: Path, out: Path | None, overrides: Sequence[str], rate: float | None, quiet: bool) -> None:
    """Replay every trajectory of a session; write `online.csv` and `replay.json`.

    Raises:
        JaxgeoError: bad input, or anchors that do not fix the frame by the end; nothing is written then.
    """
    if rate is not None and not (math.isfinite(rate) and rate > 0.0):
        raise ConfigError(f"--rate is {rate}; expected seconds of the recording a second, above 0: 1 as it was.")
    config = load_config(path, overrides)
    # What detection, odometry and mapping make of images and scans is shared with `jaxgeo run`.
    session = Path("out") / config.name if out is None else out
    out = session / "replay" if out is None else out
    check_output_folder(out)

    from jaxgeo.cli.ingest import ingest
    from jaxgeo.cli.session import named
    from jaxgeo.export.json_text import json_text
    from jaxgeo.export.session_files import folder_name
    from jaxgeo.io.atomic import output_folder

    keep_compiled_programs()
    texts: dict[str, str] = {}
    facts: dict[str, Any] = {}
    with Progress(quiet) as progress:
        progress.phase("read", config.name)
        data = ingest(config, progress, session)
        for name, source in config.trajectories.items():
            with named(name):
                folder = "" if len(config.trajectories) == 1 else f"{folder_name(name)}/"
                texts[f"{folder}{ONLINE_FILE}"], facts[name] = _replay_one(name, source, config, data, rate, progress)
        texts[REPLAY_FILE] = json_text(
            {"session": config.name, "simulated": config.simulated, "rate": rate, "trajectories": facts}
        )
        progress.phase("write", str(out))
        with output_folder(out) as temporary:
            for file, text in texts.items():
                (temporary / file).parent.mkdir(exist_ok=True)
                (temporary / file).write_text(text, encoding="utf-8", newline="\n")
    if not quiet:
        label = " (simulated data)" if config.simulated else ""
        for name, found in facts.items():
            for sentence in found["warnings"]:
                print(f"warning: {name}: {sentence}", file=sys.stderr)
            print(f"{name}{label}: {_summary(found)}")
        print(f"{config.name}{label}: {out / REPLAY_FILE}")


def _replay_one(
    name: str, source: AnyTrajectoryInput, config: SessionConfig, data: Any, rate: float | None, progress: Progress
) -> tuple[str, dict[str, Any]]:
    """One trajectory: its online.csv, and what replay.json says of it."""
    from jaxgeo.cli.session import Clock, anchored, settings_of
    from jaxgeo.cli.session_corrections import as_recorded
    from jaxgeo.online import OnlineGeoreference
    from jaxgeo.online.replay import replay

    settings = settings_of(config)
    noise, said = known_noise(config, source)
    # Refuses exchanged axes and the like before anything is replayed.
    trajectory, anchors, about = anchored(name, settings, data, Clock(progress, name))
    online = OnlineGeoreference(data.survey, data.frame, noise, online_settings(config, len(trajectory), len(anchors)))
    progress.phase("compile", name)
    online.warm_up()
    # What was made so far stays: going through it takes the collector tenths of a second, in the midst of a push.
    gc.collect()
    gc.freeze()
    progress.phase("replay", name)
    with progress.count("poses", len(trajectory)) as bar:

        def told(pose: Any, update: Any, took_s: float) -> None:
            bar.done()
            if update is not None:
                progress.say(_line(pose, update, took_s))

        found = replay(online, trajectory, data.sightings, rate=rate, after_pose=told)
    gc.unfreeze()
    progress.phase("compare with the batch answer", name)
    batch_m = batch_positions_m(trajectory, anchors, noise, settings)
    apart_m = np.linalg.norm(found.result.corrected.position_m - batch_m, axis=1)
    facts = {
        "n_poses": len(trajectory),
        "n_anchors": len(found.result.anchors),
        "noise": said[0],
        "first_georeferenced_s": _first_georeferenced_s(found),
        "online_minus_final_m": _online_minus_final(found, data.frame.to_grid(found.result.corrected.position_m)),
        "final_minus_batch_m": {"max": float(apart_m.max()), "rms": float(np.sqrt(np.mean(apart_m**2)))},
        "latency_ms": {kind: _quantiles_ms(times) for kind, times in found.latency_s.items()},
        "behind_ms": None if rate is None else _quantiles_ms(found.behind_s),
        "warnings": [*as_recorded(config, "jaxgeo replay"), *said[1:], *dict.fromkeys((*about, *online.warnings))],
    }
    return _online_text(config, data.frame, name, found), facts


def online_settings(config: SessionConfig, poses: int, anchors: int) -> Any:
    """What the batch job takes of the config, and room for this very recording."""
    from jaxgeo.cli.session import settings_of
    from jaxgeo.online import Labels, OnlineSettings

    visits = config.visits
    whole = isinstance(config.sightings, FromTrajectorySightingsInput | ControlPointSightingsInput)
    return OnlineSettings(
        gap_s=_ANY_PAUSE_S if whole else visits.gap_s,
        min_count=1 if whole else visits.min_count,
        labels=Labels(
            order=None if visits.order is None else tuple(visits.order),
            locations=dict(visits.locations),
            ignore=tuple(config.survey.ignore) if config.survey else (),
        ),
        solve=settings_of(config),
        capacity=poses,
        capacity_anchors=anchors,
    )


def known_noise(config: SessionConfig, source: AnyTrajectoryInput) -> tuple[Any, list[str]]:
    """The noise that was known before the session, which it is in words, and what is to be said of it."""
    from jaxgeo.cli.noise import noise_of, stored_ensemble, stored_noise

    stored = stored_noise(config, source)
    noise = noise_of(source, config) if stored is None else stored_ensemble(stored)
    which = "fixed" if stored is None else f"learned earlier ({config.noise.file})"
    if config.noise.mode == "fixed":
        return noise, [which]
    return noise, [
        which,
        f"noise.mode is learned, but a session's noise is learned from its end: on the way the noise is the one "
        f"known before it, {which}. Name a noise.json of an earlier session with noise.file.",
    ]


def batch_positions_m(trajectory: Any, anchors: Any, noise: Any, settings: Any) -> np.ndarray:
    from eval.loo import correct_under_and_hold_out
    from jaxgeo.graph.noise import OdometryNoise
    from jaxgeo.solve.correct import correct

    if isinstance(noise, OdometryNoise):
        return correct(trajectory, anchors, noise, settings).corrected.position_m
    return correct_under_and_hold_out(trajectory, anchors, settings, noise, None)[0].corrected.position_m


def _online_text(config: SessionConfig, frame: Any, name: str, found: Any) -> str:
    from jaxgeo.export.csv_text import csv_text

    east, north, height = (repr(float(x)) for x in frame.origin_enh_m)
    comments = [
        *(["SIMULATED DATA: not a measurement"] if config.simulated else []),
        f"jaxgeo replay of trajectory '{name}': body poses in the grid, as they were known at their own moment",
        f"session: {config.name}",
        f"crs: {frame.crs} ({frame.crs_name}); height: {frame.height}",
        f"local frame = grid minus origin; origin E={east} N={north} h={height} m",
        "qw qx qy qz turns body axes into grid axes (E, N, h); sigma_r* about a grid axis; empty: not determined yet",
    ]
    numbers = np.column_stack([found.stamp_s, found.enh_m, found.quat_wxyz, found.sigma]).tolist()
    rows = zip(
        numbers,
        found.n_anchors.tolist(),
        np.where(np.isfinite(found.anchor_age_s), found.anchor_age_s, np.nan).tolist(),
        found.status,
        strict=True,
    )
    return csv_text(comments, COLUMNS, ((*row, count, age_s, status) for row, count, age_s, status in rows))


def _line(pose: Any, update: Any, took_s: float) -> str:
    """One anchor, on the terminal."""
    what = f"{pose.stamp_s:.2f} s  {', '.join(update.new) or 'nothing new'}: {update.n_anchors} anchors"
    if not np.all(np.isfinite(pose.enh_m)):
        return f"{what}, {update.status}: {update.words}"
    sigma_m = np.sqrt(np.diag(pose.covariance)[:3])
    at = " ".join(f"{axis} {x:.2f}" for axis, x in zip("ENh", pose.enh_m, strict=True))
    spread = " ".join(f"{s:.2f}" for s in sigma_m)
    words = f": {update.words}" if update.words else ""
    return f"{what}, {update.status}, {at} (sigma {spread} m), {1e3 * took_s:.1f} ms{words}"


def _first_georeferenced_s(found: Any) -> float | None:
    at = [stamp_s for stamp_s, status in zip(found.stamp_s, found.status, strict=True) if status == "georeferenced"]
    return float(at[0]) if at else None


def _online_minus_final(found: Any, final_enh_m: np.ndarray) -> dict[str, float] | None:
    """How far what was known at the moment lies from what is known in the end."""
    known = np.all(np.isfinite(found.enh_m), axis=1)
    if not known.any():
        return None
    apart_m = np.linalg.norm(found.enh_m[known] - final_enh_m[known], axis=1)
    return {"median": float(np.median(apart_m)), "p95": float(np.percentile(apart_m, 95)), "max": float(apart_m.max())}


def _quantiles_ms(times_s: np.ndarray) -> dict[str, float] | None:
    if len(times_s) == 0:
        return None
    p50, p99, most = 1e3 * np.percentile(times_s, [50, 99, 100])
    return {"count": len(times_s), "p50": float(p50), "p99": float(p99), "max": float(most)}


def _summary(found: dict[str, Any]) -> str:
    anchor, odometry = found["latency_ms"]["anchor"], found["latency_ms"]["odometry"]
    times = f"odometry p99 {odometry['p99']:.2f} ms"
    if anchor is not None:
        times = f"anchor p50 {anchor['p50']:.1f}, max {anchor['max']:.1f} ms; {times}"
    return (
        f"{found['n_poses']} poses, {found['n_anchors']} anchors; {times}; "
        f"the end differs from the batch answer by at most {1e3 * found['final_minus_batch_m']['max']:.2g} mm"
    )
