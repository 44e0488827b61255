"""Learned odometry noise on simulated sessions of known noise: `python -m benchmarks.calibration [--json]`.

Every draw is a session of the reference study's layout (six locations, seven visits, 1 829 poses) with an odometry
drawn from one of three regimes, learned from and held out location by location:

    white      white noise, 0.14 m and 7 mrad per sqrt(m): raw revisit gaps of some metres; assumed right
    biased     white noise, 0.02 m and 2 mrad per sqrt(m), and a constant bias, 15 mm and 1 mrad per m, drawn per axis
    misassumed the white regime, its assumed noise (lidar's defaults) seven times too small

Noise is per metre of the odometry's own length, which noise makes longer than the true one (a sixth in the white
regime): the true sigmas are converted to it.

Simulated throughout: it shows what learning costs and gains where the truth is known, not how real odometry errs.
"""

import dataclasses
import functools
import json
import multiprocessing
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import typer
from jaxtyping import Float

from benchmarks.timing import medians_s
from calibration.calibrate import LearnSettings, learn_options
from calibration.learn import Learned, learn_folds, prior_arrays
from calibration.models import FamilyPrior
from calibration.summary import summarise
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.graph.components import NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import OdometryNoise, odometry_noise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.precision import enable_compilation_cache
from jaxgeo.simulate import Drift, simulate_session
from jaxgeo.simulate.session import ORDER, ORIGIN_ENH_M, VISIT_SIGMA_M
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_fold import solve_ensemble
from jaxgeo.solve.fold import FoldOptions, solve_fold

KIND = "lidar"
SETTINGS = Settings(extra_sigma_m=VISIT_SIGMA_M)
GAP_S = 5.0
# Identifiable: the estimate claims to know log sigma to this standard deviation or better, a factor of 1.5.
IDENTIFIABLE_LOG_SD = float(np.log(1.5))
# At a bound: the estimate lies this many prior standard deviations from the prior's median.
BOUND_SD = 4.0


@dataclasses.dataclass(frozen=True)
class Regime:
    """True standard deviations, every axis alike; `assumed` the fixed noise, whose white sigmas centre the prior."""

    sigma_trans: float
    sigma_rot: float
    bias_trans: float
    bias_rot: float
    assumed: OdometryNoise

    def truth(self, longer: float) -> OdometryNoise:
        """Per metre of an odometry that is `longer` times the true path."""
        return odometry_noise(
            self.sigma_trans / np.sqrt(longer),
            self.sigma_rot / np.sqrt(longer),
            sigma_bias_trans_m_per_m=self.bias_trans / longer,
            sigma_bias_rot_rad_per_m=self.bias_rot / longer,
        )


def regimes() -> dict[str, Regime]:
    right = default_noise(KIND, sigma_trans_m_per_sqrt_m=0.14, sigma_rot_rad_per_sqrt_m=0.007)
    return {
        "white": Regime(0.14, 0.007, 0.0, 0.0, right),
        "biased": Regime(0.02, 0.002, 0.015, 0.001, default_noise(KIND)),
        "misassumed": Regime(0.14, 0.007, 0.0, 0.0, default_noise(KIND)),
    }


def path_m(trajectory: Trajectory) -> float:
    return float(np.linalg.norm(np.diff(trajectory.position_m, axis=0), axis=1).sum())


def axes(value: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = value.tolist()
    return x, y, z


def draw(job: tuple[Regime, int]) -> tuple[Trajectory, Anchors, float]:
    """One simulated session: its odometry, its anchors, and how many times longer the odometry is than the truth."""
    regime, seed = job
    bias = np.random.default_rng([seed, 7]).standard_normal((2, 3))
    drift = Drift(
        sigma_trans_m_per_sqrt_m=axes(np.full(3, regime.sigma_trans)),
        sigma_rot_rad_per_sqrt_m=axes(np.full(3, regime.sigma_rot)),
        bias_trans_m_per_m=axes(regime.bias_trans * bias[0]),
        bias_rot_rad_per_m=axes(regime.bias_rot * bias[1]),
    )
    session = simulate_session(seed, drift={"odometry": drift})
    visits, _ = label_visits(cut_visits(session.sightings, GAP_S), session.survey, order=list(ORDER))
    trajectory = session.trajectories["odometry"]
    anchors, _ = make_anchors(trajectory, session.sightings, visits, session.survey, origin_enh_m=ORIGIN_ENH_M)
    return trajectory, anchors, path_m(trajectory) / path_m(session.truth)


@functools.partial(jax.jit, static_argnames="options")
def points_under(
    chain: Chain,
    table: AnchorTable,
    ensemble: NoiseEnsemble,
    use: Float[jax.Array, "f k"],
    options: FoldOptions,
) -> Float[jax.Array, "f k 3"]:
    """Every fold's predicted markers under a known noise."""
    width = jnp.asarray(SETTINGS.loss_width)

    def one(row: jax.Array) -> jax.Array:
        return solve_ensemble(chain, table, ensemble, row, width, options).point_m

    return jax.lax.map(one, use)


@dataclasses.dataclass(frozen=True)
class Draw:
    """Held-out errors of every visit, (k,) each, and what was learned of the two white sigmas from all anchors."""

    error_m: dict[str, Float[np.ndarray, "k"]]
    inside_95: Float[np.ndarray, "k"]
    ratio: Float[np.ndarray, "2"]
    identifiable: Float[np.ndarray, "2"]
    covered_95: Float[np.ndarray, "2"]
    covered_68: Float[np.ndarray, "2"]
    bias_weight: float
    stuck: bool


def evaluate(regime: Regime, trajectory: Trajectory, anchors: Anchors, longer: float) -> Draw:
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, SETTINGS.extra_sigma_m)
    learn = LearnSettings(KIND, regime.assumed)
    options = learn_options(SETTINGS, learn)
    n = int(anchors.location_index.max()) + 1
    use = np.zeros((1 + n, len(np.asarray(table.real))))
    use[:, : len(anchors)] = 1.0
    use[1:, : len(anchors)] = np.arange(n)[:, None] != anchors.location_index[None]
    rows, width = jnp.asarray(use), jnp.asarray(SETTINGS.loss_width)
    found, _ = learn_folds(chain, table, prior_arrays(learn.family), rows, width, options)
    visit = np.arange(len(anchors))
    fold = 1 + anchors.location_index

    def error(points: Any) -> Float[np.ndarray, "k 3"]:
        return np.asarray(points)[fold, visit] - anchors.surveyed_enh_m

    true_noise = regime.truth(longer)
    under = {"true": ensemble_of(true_noise), "fixed": ensemble_of(regime.assumed)}
    errors = {name: error(points_under(chain, table, ensemble, rows, options.fold)) for name, ensemble in under.items()}
    errors["learned"] = error(found.fold.point_m)
    covariance = np.asarray(found.fold.error_covariance_m2)[fold, visit]
    nees = np.einsum("ka,kab,kb->k", errors["learned"], np.linalg.inv(covariance), errors["learned"])
    whole: Learned = jax.tree.map(lambda x: np.asarray(x)[0], found)
    summary = summarise(whole, learn.family, KIND, "both", anchors)
    sigmas = {s.component: s for s in summary.sigmas}
    white = [sigmas["trans_m_per_sqrt_m"], sigmas["rot_rad_per_sqrt_m"]]
    truth = np.array([true_noise.sigma_trans_m_per_sqrt_m[0], true_noise.sigma_rot_rad_per_sqrt_m[0]])
    return Draw(
        error_m={name: np.linalg.norm(e, axis=1) for name, e in errors.items()},
        inside_95=(nees < 7.814727903251179).astype(float),
        ratio=np.array([s.median for s in white]) / truth,
        identifiable=np.array([float(s.log_sd < IDENTIFIABLE_LOG_SD) for s in white]),
        covered_95=np.array([s.low_95 <= t <= s.high_95 for s, t in zip(white, truth, strict=True)], dtype=float),
        covered_68=np.array([s.low_68 <= t <= s.high_68 for s, t in zip(white, truth, strict=True)], dtype=float),
        bias_weight=sum(m.weight for m in summary.models if "bias" in m.name),
        stuck=_stuck(found, learn.family),
    )


def _stuck(found: Learned, family: FamilyPrior) -> bool:
    """Whether any fold did not settle, or its heaviest model did not converge or ran away from its prior."""
    folds = np.arange(len(np.asarray(found.model_weight)))
    best = np.argmax(np.asarray(found.model_weight), axis=1)
    theta = np.asarray(found.fit.theta)[folds, best]
    mean = np.asarray(found.prior.mean)[folds, best]
    free = family.free[best] > 0
    away = np.abs(theta - mean) / np.sqrt(np.diag(family.covariance)) * free
    settled = np.asarray(found.fold.settled) & np.asarray(found.fit.converged)[folds, best]
    return bool(np.any(~settled) or np.any(away > BOUND_SD))


def interval(numerator: np.ndarray, denominator: np.ndarray, seed: int = 0) -> tuple[float, float]:
    """95 % bootstrap interval of a ratio of means over draws."""
    random = np.random.default_rng(seed)
    pick = random.integers(0, len(numerator), (2000, len(numerator)))
    ratio = numerator[pick].mean(axis=1) / denominator[pick].mean(axis=1)
    low, high = np.quantile(ratio, [0.025, 0.975])
    return float(low), float(high)


def summary_of(draws: list[Draw]) -> dict[str, Any]:
    mean = {name: np.array([d.error_m[name].mean() for d in draws]) for name in draws[0].error_m}
    identifiable = np.array([d.identifiable for d in draws]) > 0
    within = np.abs(np.log(np.array([d.ratio for d in draws]))) < np.log(1.5)
    return {
        "draws": len(draws),
        "error_mean_m": {name: float(v.mean()) for name, v in mean.items()},
        "error_ratio_to_true_noise": float(mean["learned"].mean() / mean["true"].mean()),
        "error_ratio_interval_95": interval(mean["learned"], mean["true"]),
        "error_ratio_fixed_to_true": float(mean["fixed"].mean() / mean["true"].mean()),
        "sigma_within_1p5_share": float(within[identifiable].mean()) if identifiable.any() else None,
        "sigma_within_1p5_trans_rot": within.mean(axis=0).tolist(),
        "identifiable_share_trans_rot": identifiable.mean(axis=0).tolist(),
        "sigma_median_ratio_trans_rot": np.median([d.ratio for d in draws], axis=0).tolist(),
        "interval_coverage_95": float(np.mean([d.covered_95 for d in draws])),
        "interval_coverage_95_trans_rot": np.mean([d.covered_95 for d in draws], axis=0).tolist(),
        "interval_coverage_68": float(np.mean([d.covered_68 for d in draws])),
        "held_out_inside_95": float(np.mean([d.inside_95 for d in draws])),
        "bias_weight_mean": float(np.mean([d.bias_weight for d in draws])),
        "stuck_share": float(np.mean([d.stuck for d in draws])),
    }


def cost_solves() -> dict[str, float]:
    """Warm time of learning from all anchors of one 1 829-pose session, in solves of the same session's graph."""
    regime = regimes()["white"]
    trajectory, anchors, _ = draw((regime, 0))
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, SETTINGS.extra_sigma_m)
    learn = LearnSettings(KIND, regime.assumed)
    options, width = learn_options(SETTINGS, learn), jnp.asarray(SETTINGS.loss_width)
    one = table.real[None]
    many = jnp.tile(one, (7, 1))
    family = prior_arrays(learn.family)
    solve_s, learn_s, folds_s = medians_s(
        9,
        lambda: solve_fold(chain, table, regime.assumed, table.real, width, options.fold),
        lambda: learn_folds(chain, table, family, one, width, options),
        lambda: learn_folds(chain, table, family, many, width, options),
    )
    return {
        "cost_solves": learn_s / solve_s,
        "solve_ms": 1e3 * solve_s,
        "learn_ms": 1e3 * learn_s,
        "seven_folds_ms": 1e3 * folds_s,
    }


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    draws: int = typer.Option(200, help="Simulated sessions per regime."),
    first_seed: int = typer.Option(0, help="Seed of the first; the next ones follow."),
    only: str = typer.Option("", help="One regime only."),
    workers: int = typer.Option(3, help="Processes that simulate."),
) -> None:
    enable_compilation_cache()
    out: dict[str, Any] = {"simulated": True, "regimes": {}}
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for name, regime in regimes().items():
            if only and name != only:
                continue
            started = time.perf_counter()
            jobs = [(regime, first_seed + i) for i in range(draws)]
            found = [evaluate(regime, *session) for session in pool.imap(draw, jobs, chunksize=2)]
            out["regimes"][name] = summary_of(found) | {"seconds": time.perf_counter() - started}
            if not as_json:
                print(name, "(simulated)", json.dumps(out["regimes"][name], indent=1))
    out |= cost_solves()
    print(json.dumps(out) if as_json else json.dumps({k: v for k, v in out.items() if k != "regimes"}, indent=1))


if __name__ == "__main__":
    typer.run(main)
