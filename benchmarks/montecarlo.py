"""Sessions a second of the Monte-Carlo study: `python -m benchmarks.montecarlo [--json] [--draws N,N]`.

The same work in a plain Python loop, one session after the other, simulated and evaluated, is the peer: the same
compiled work, called with one session at a time, and each simulated in between.
"""

import json
import time
from typing import Any

import typer

from jaxgeo.precision import enable_compilation_cache

REGIMES = "white,biased,misassumed,gauss-markov,heavy-tailed,scale"


def measure(sizes: list[int], loop: int, workers: int, poses: int, devices: list) -> dict[str, Any]:
    """Rows for these numbers of sessions, and the loop over the first `loop` of them."""
    import jax
    import numpy as np

    from eval.montecarlo.batch import evaluate_session, session_mesh
    from eval.montecarlo.records import record
    from eval.montecarlo.regimes import regimes_named
    from eval.montecarlo.sessions import session_arrays
    from eval.montecarlo.settings import study_settings
    from eval.montecarlo.study import evaluated
    from jaxgeo.cli.machine import device_words

    regimes = regimes_named(REGIMES)
    settings = study_settings(max(sizes), 0, regimes, platform=devices[0].platform, poses=poses)
    mesh = session_mesh(devices)
    alone = jax.jit(evaluate_session)

    def one(i: int) -> Any:
        regime, seed = settings.regime_of(i), settings.seed_of(i)
        arrays = session_arrays(regime, seed, settings.layout)
        outcome = jax.tree.map(np.asarray, jax.block_until_ready(alone(arrays)))
        return record(i, seed, i % len(regimes), regime, arrays, outcome)

    def warm() -> float:
        started = time.perf_counter()
        list(evaluated(settings, list(range(min(sizes[0], settings.batch * len(devices)))), mesh, 0))
        return time.perf_counter() - started

    first_call_s = warm()
    one(0)
    started = time.perf_counter()
    kept = [one(i) for i in range(loop)]
    loop_s = (time.perf_counter() - started) / loop
    rows = []
    for size in sizes:
        started = time.perf_counter()
        found = list(evaluated(settings, list(range(size)), mesh, workers))
        seconds = time.perf_counter() - started
        apart_m = max(float(np.abs(a.error_m - b.error_m).max()) for a, b in zip(found, kept, strict=False))
        rows.append(
            {
                "sessions": size,
                "seconds": seconds,
                "sessions_per_s": size / seconds,
                "ratio_to_loop": loop_s * size / seconds,
                "largest_difference_to_loop_m": apart_m,
                "failed": int(sum(int(each.failed[0]) for each in found)),
            }
        )
    return {
        "simulated": True,
        "device": device_words(),
        "devices": len(devices),
        "batch": settings.batch,
        "workers": workers,
        "poses": poses,
        "first_call_s": first_call_s,
        "loop_sessions_per_s": 1.0 / loop_s,
        "rows": rows,
    }


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    draws: str = typer.Option("1000", help="Numbers of sessions, separated by commas: 1000,10000."),
    loop: int = typer.Option(50, min=1, help="Sessions of the plain loop."),
    workers: int = typer.Option(-1, help="Processes that simulate; default half of the cores."),
    devices: int = typer.Option(0, help="Devices; default all."),
    poses: int = typer.Option(1829, help="Poses of a session."),
) -> None:
    # Before the modules that make arrays as they are imported: it says how many devices there are.
    from eval.montecarlo.devices import cores, study_devices

    found_devices = study_devices(devices or None)
    enable_compilation_cache()
    sizes = [int(part) for part in draws.split(",")]
    found = measure(sizes, loop, max(1, cores() // 2) if workers < 0 else workers, poses, found_devices)
    if as_json:
        print(json.dumps(found))
        return
    print(f"{found['device']}, {found['devices']} device(s), simulated sessions of {poses} poses")
    print(f"plain loop: {found['loop_sessions_per_s']:.1f} sessions a second")
    for row in found["rows"]:
        print(
            f"{row['sessions']} sessions: {row['seconds']:.0f} s, {row['sessions_per_s']:.1f} a second, "
            f"{row['ratio_to_loop']:.1f} times the loop"
        )


if __name__ == "__main__":
    typer.run(main)
