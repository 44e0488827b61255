"""The solver against GTSAM, and its own cost: `python -m benchmarks.solver [--json]`. See benchmarks/README.md."""

import dataclasses
import functools
import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import typer
from jaxtyping import Array, Float

from benchmarks.chain import FULL, FULL_TERMS, chain_graph
from benchmarks.peer import Peer
from benchmarks.timing import medians_s
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.pose_graph import PoseGraph
from jaxgeo.solve.solver import Solution, result_words, solve_graph, solve_graph_differentiably, succeeded

# Visits of the paper's session: seven, the last at the first one's location.
VISITS = {"A": (0, 6), "B": (1,), "C": (2,), "D": (3,), "E": (4,), "F": (5,)}
# Subsets solved at a time; on CPUs 1 to 41 differ by less than a third.
SUBSET_BATCH = 8
_PACKAGES = ("jax", "jaxlib", "optimistix", "lineax", "equinox", "numpy", "gtsam")


@dataclasses.dataclass(frozen=True)
class Sizes:
    """What is run: poses of the chains, repetitions of each."""

    short: int = 1829
    long: int = 20_000
    longest: int = 1_000_000
    longest_anchors: int = 100
    short_repetitions: int = 25
    long_repetitions: int = 9
    subset_repetitions: int = 7


@jax.jit
def solve(graph: PoseGraph) -> Solution:
    return solve_graph(graph)


@jax.jit
def solve_subsets(graph: PoseGraph, use: Float[Array, "s k"]) -> Solution:
    """The graph with each row's anchors only, all poses kept."""

    def one(row: Float[Array, "k"]) -> Solution:
        weight = graph.anchors.sqrt_information * row[:, None, None]
        return solve_graph(eqx.tree_at(lambda g: g.anchors.sqrt_information, graph, weight))

    return jax.lax.map(one, use, batch_size=SUBSET_BATCH)


@jax.jit
def spread_and_gradient(noise: OdometryNoise, graph: PoseGraph) -> tuple[Array, OdometryNoise]:
    """Mean square of the solved positions, and its gradient in every noise parameter."""

    def spread(noise: OdometryNoise) -> Array:
        poses = solve_graph_differentiably(eqx.tree_at(lambda g: g.noise, graph, noise)).poses
        return sum((jnp.mean(c * c) for c in poses.t), start=jnp.zeros(()))

    return jax.value_and_grad(spread)(noise)


def subsets() -> list[tuple[int, ...]]:
    """Visits of the 41 subsets of three to five of the six locations."""
    return [
        tuple(j for name in names for j in VISITS[name])
        for count in (3, 4, 5)
        for names in itertools.combinations(VISITS, count)
    ]


def against_gtsam(n: int, repetitions: int) -> dict[str, Any]:
    """One solve of n poses with 7 anchors."""
    graph = chain_graph(n, 7)
    peer = Peer(graph, n, range(7))
    peer_cost, iterations = peer.solve()
    found = solve(graph)
    gtsam_s, ours_s = medians_s(repetitions, peer.solve, lambda: solve(graph))
    cost = float(found.cost)
    return {
        "ratio": gtsam_s / ours_s,
        "gtsam_s": gtsam_s,
        "ours_s": ours_s,
        "relative_cost_difference": abs(cost - peer_cost) / peer_cost,
        "gtsam_iterations": iterations,
        "our_steps": int(found.steps),
        "result": result_words(found.result),
    }


def subsets_against_gtsam(n: int, repetitions: int) -> dict[str, Any]:
    """All 41 subsets of the anchors: one compiled call, and as many solves of GTSAM."""
    graph = chain_graph(n, 7)
    chosen = subsets()
    use = np.zeros((len(chosen), graph.anchors.pose_index.shape[0]))
    for row, visits in zip(use, chosen, strict=True):
        row[list(visits)] = 1.0
    use = jnp.asarray(use)
    peers = [Peer(graph, n, visits) for visits in chosen]
    peer_cost = np.array([peer.solve()[0] for peer in peers])
    found = solve_subsets(graph, use)
    gtsam_s, ours_s = medians_s(
        repetitions, lambda: [peer.solve() for peer in peers], lambda: solve_subsets(graph, use)
    )
    return {
        "ratio": gtsam_s / ours_s,
        "gtsam_s": gtsam_s,
        "ours_s": ours_s,
        "n_subsets": len(chosen),
        "relative_cost_difference": float(np.max(np.abs(np.asarray(found.cost) - peer_cost) / peer_cost)),
        "all_converged": bool(np.all(succeeded(found.result))),
    }


def gradient_cost(n: int, repetitions: int) -> dict[str, Any]:
    """Solve and gradient in every noise parameter (bias and log-scale in the graph), in units of the solve alone."""
    graph = chain_graph(n, 7, noise=FULL, terms=FULL_TERMS)
    solve_s, gradient_s = medians_s(repetitions, lambda: solve(graph), lambda: spread_and_gradient(graph.noise, graph))
    _, gradient = spread_and_gradient(graph.noise, graph)
    finite = all(np.all(np.isfinite(g)) for g in jax.tree.leaves(gradient))
    return {"solves": gradient_s / solve_s, "solve_s": solve_s, "value_and_gradient_s": gradient_s, "finite": finite}


def child(*arguments: str, cache: str | None = None) -> Any:
    """What a module of the benchmarks prints as JSON in a process of its own."""
    environment = os.environ | ({"JAXGEO_CACHE": cache} if cache else {})
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-m", *arguments], cwd=root, env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout)


def compile_times(n: int) -> dict[str, float]:
    """First solve of a process: with an empty cache, and with the one that the first process left."""
    with tempfile.TemporaryDirectory() as folder:
        first = functools.partial(child, "benchmarks.first_call", str(n), cache=folder)
        return {"cold_s": first(), "cached_s": first()}


def measure(sizes: Sizes) -> dict[str, Any]:
    """Everything; the flat keys are the figures to quote, the nested ones say what they are made of."""
    short = against_gtsam(sizes.short, sizes.short_repetitions)
    long = against_gtsam(sizes.long, sizes.long_repetitions)
    subset = subsets_against_gtsam(sizes.short, sizes.subset_repetitions)
    gradient = gradient_cost(sizes.short, sizes.short_repetitions)
    gradient_long = gradient_cost(sizes.long, sizes.long_repetitions)
    longest, astray = (
        child("benchmarks.million", str(sizes.longest), str(sizes.longest_anchors), noise)
        for noise in ("lidar", "paper")
    )
    compiled = compile_times(sizes.short)
    per_pose = [case["ours_s"] / case["our_steps"] / n for case, n in ((short, sizes.short), (long, sizes.long))]
    per_pose.append(longest["warm_s"] / longest["steps"] / sizes.longest)
    return {
        "chain_1829_ratio": short["ratio"],
        "chain_20000_ratio": long["ratio"],
        "subsets_41_ratio": subset["ratio"],
        "million_poses_s": longest["warm_s"],
        "million_poses_gib": longest["peak_gib"],
        "gradient_cost_solves": gradient["solves"],
        "gradient_cost_solves_20000": gradient_long["solves"],
        "compile_cold_s": compiled["cold_s"],
        "compile_cached_s": compiled["cached_s"],
        "ns_per_pose_and_step": dict(zip(("short", "long", "longest"), (1e9 * t for t in per_pose), strict=True)),
        "relative_cost_difference": max(case["relative_cost_difference"] for case in (short, long, subset)),
        "chain_1829": short,
        "chain_20000": long,
        "subsets_41": subset,
        "gradient_1829": gradient,
        "gradient_20000": gradient_long,
        "million_poses": longest,
        "million_poses_astray": astray,
        "machine": {"cores": os.cpu_count(), "load_1_min": os.getloadavg()[0], "processor": platform.machine()},
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
        "sizes": dataclasses.asdict(sizes),
    }


def print_table(found: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("case", "GTSAM", "jaxgeo", "ratio", "relative cost difference", title="Solve, warm (medians)")
    for title, key in (("1 829 poses", "chain_1829"), ("20 000 poses", "chain_20000"), ("41 subsets", "subsets_41")):
        case = found[key]
        times = (f"{1e3 * case[side]:.1f} ms" for side in ("gtsam_s", "ours_s"))
        table.add_row(title, *times, f"{case['ratio']:.1f}", f"{case['relative_cost_difference']:.1e}")
    console = Console()
    console.print(table)
    longest, astray = found["million_poses"], found["million_poses_astray"]
    per_pose = found["ns_per_pose_and_step"]
    for line in (
        f"1 000 000 poses, 100 anchors: {longest['warm_s']:.2f} s warm, {longest['first_call_s']:.2f} s first call, "
        f"{longest['peak_gib']:.2f} GiB at most ({longest['result']}, {longest['steps']} steps)",
        f"the same, its heading lost by two radians before any anchor is used: {astray['warm_s']:.2f} s "
        f"({astray['result']}, {astray['steps']} steps)",
        "per pose and step: " + ", ".join(f"{name} {ns:.0f} ns" for name, ns in per_pose.items()),
        f"value and gradient in all noise parameters: {found['gradient_cost_solves']:.1f} solves (1 829 poses), "
        f"{found['gradient_cost_solves_20000']:.1f} (20 000)",
        f"first solve of a process: {found['compile_cold_s']:.1f} s, {found['compile_cached_s']:.1f} s from the cache",
        f"{found['machine']['cores']} cores, load {found['machine']['load_1_min']:.1f}; "
        + ", ".join(f"{name} {number}" for name, number in found["versions"].items()),
    ):
        console.print(line, highlight=False)


def main(as_json: bool = typer.Option(False, "--json", help="One JSON object instead of a table.")) -> None:
    found = measure(Sizes())
    print(json.dumps(found)) if as_json else print_table(found)


if __name__ == "__main__":
    typer.run(main)
