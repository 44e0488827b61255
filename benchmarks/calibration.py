"""Learned odometry noise on simulated sessions of known noise: `python -m benchmarks.calibration [--json]`.

Three regimes of the Monte-Carlo study (`eval.montecarlo.regimes`) at full length: six locations, seven visits, 1 829
poses; and what learning costs, in solves. `jaxgeo study montecarlo` has all regimes, tables and intervals.

Simulated throughout: it shows what learning costs and gains where the truth is known, not how real odometry errs.
"""

import json
import time
from typing import Any

import typer

from benchmarks.timing import medians_s
from jaxgeo.precision import enable_compilation_cache

REGIMES = ("white", "biased", "misassumed")


def summary_of(draws: list) -> dict[str, Any]:
    """The figures of one regime's sessions, in the words that this benchmark has always had."""
    import numpy as np

    from eval.bootstrap import bootstrap_interval, ratio_of_means
    from eval.montecarlo.batch import STAGES
    from eval.montecarlo.records import bias_weight, together
    from eval.montecarlo.summary import WHITE, covered, identifiable, session_error_m, sigma_ratio, within
    from jaxgeo.export.held_out_stats import chi_square_quantile, normalised_squared_errors

    records = together(draws)
    mean_m = dict(zip(STAGES, session_error_m(records).T, strict=True))
    pair = np.stack([mean_m["learned"], mean_m["true"]], axis=1)
    near, known, inside_95, inside_68 = (
        np.stack([f(records, name) for name in WHITE], axis=1)
        for f in (within, identifiable, lambda r, c: covered(r, c, 95), lambda r, c: covered(r, c, 68))
    )
    stage = STAGES.index("learned")
    nees = normalised_squared_errors(
        records.error_m[:, stage].reshape(-1, 3), records.covariance_m2[:, stage].reshape(-1, 3, 3)
    )
    return {
        "draws": len(records),
        "error_mean_m": {name: float(mean_m[name].mean()) for name in ("true", "fixed", "learned")},
        "error_ratio_to_true_noise": float(ratio_of_means(pair)),
        "error_ratio_interval_95": bootstrap_interval(pair, ratio_of_means, seed=0),
        "error_ratio_fixed_to_true": float(mean_m["fixed"].mean() / mean_m["true"].mean()),
        "sigma_within_1p5_share": float(near[known].mean()) if known.any() else None,
        "sigma_within_1p5_trans_rot": near.mean(axis=0).tolist(),
        "identifiable_share_trans_rot": known.mean(axis=0).tolist(),
        "sigma_median_ratio_trans_rot": [float(np.median(sigma_ratio(records, name))) for name in WHITE],
        "interval_coverage_95": float(inside_95.mean()),
        "interval_coverage_95_trans_rot": inside_95.mean(axis=0).tolist(),
        "interval_coverage_68": float(inside_68.mean()),
        "held_out_inside_95": float(np.mean(nees <= chi_square_quantile(0.95, 3))),
        "bias_weight_mean": float(bias_weight(records).mean()),
        "stuck_share": float(records.stuck.mean()),
    }


def cost_solves() -> dict[str, float]:
    """Warm time of learning from all anchors of one 1 829-pose session, in solves of the same session's graph."""
    import jax.numpy as jnp

    from calibration.calibrate import learn_options
    from calibration.learn import learn_folds
    from eval.montecarlo.regimes import REGIMES as ALL
    from eval.montecarlo.sessions import session_arrays
    from eval.montecarlo.settings import LAYOUT, SOLVE
    from jaxgeo.solve.fold import solve_fold

    regime = ALL["white"]
    session = session_arrays(regime, 0, LAYOUT)
    chain, table = session.chain, session.table
    options, width = learn_options(SOLVE, regime.learn), jnp.asarray(SOLVE.loss_width)
    one = jnp.asarray(table.real)[None]
    many = jnp.tile(one, (7, 1))
    solve_s, learn_s, folds_s = medians_s(
        9,
        lambda: solve_fold(chain, table, session.assumed, one[0], width, options.fold),
        lambda: learn_folds(chain, table, session.family, one, width, options),
        lambda: learn_folds(chain, table, session.family, many, width, options),
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
    workers: int = typer.Option(2, help="Processes that simulate."),
) -> None:
    # Before the modules that make arrays as they are imported: it says how many devices there are.
    from eval.montecarlo.devices import study_devices

    devices = study_devices(None)

    from eval.montecarlo.batch import session_mesh
    from eval.montecarlo.regimes import regimes_named
    from eval.montecarlo.settings import study_settings
    from eval.montecarlo.study import evaluated

    enable_compilation_cache()
    mesh, out = session_mesh(devices), {"simulated": True, "regimes": {}}
    for regime in regimes_named(only or ",".join(REGIMES)):
        started = time.perf_counter()
        settings = study_settings(draws, first_seed, (regime,), platform=devices[0].platform)
        found = list(evaluated(settings, list(range(draws)), mesh, workers))
        out["regimes"][regime.name] = summary_of(found) | {"seconds": time.perf_counter() - started}
        if not as_json:
            print(regime.name, "(simulated)", json.dumps(out["regimes"][regime.name], indent=1))
    out |= cost_solves()
    print(json.dumps(out) if as_json else json.dumps({k: v for k, v in out.items() if k != "regimes"}, indent=1))


if __name__ == "__main__":
    typer.run(main)
