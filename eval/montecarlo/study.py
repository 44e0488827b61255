"""Run a study: simulate ahead, spread over the devices, keep every finished chunk."""

import contextlib
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from itertools import islice
from pathlib import Path

import jax
import numpy as np
from jax.sharding import Mesh

from eval.montecarlo.batch import SessionOutcome, evaluate_sessions, on_devices
from eval.montecarlo.chunks import read_chunks, write_chunk
from eval.montecarlo.records import Records, record, together
from eval.montecarlo.sessions import SessionArrays, stacked
from eval.montecarlo.settings import StudySettings
from eval.montecarlo.workers import simulated
from jaxgeo.precision import assert_float64

# Calls given to the devices before the first is waited for: no device waits for the host, nor for the slowest other.
IN_FLIGHT = 2
_LOOK_S = 0.02


def run_study(
    settings: StudySettings,
    folder: Path,
    mesh: Mesh,
    workers: int,
    begin: Callable[[int], None],
    done: Callable[[int], None],
    warn: Callable[[str], None],
) -> Records:
    """Every session of the study, from the folder where it is there already; finished chunks are written at once.

    Args:
        folder: opened with `chunks.open_folder`.
        mesh: the devices, in a row: `batch.session_mesh`.
        workers: processes that simulate; 0: this one.
        begin, done: told how many sessions were there, and whenever this many more are finished.
        warn: told of every file that was there and cannot be used.
    """
    assert_float64()
    found, warnings = read_chunks(folder, settings)
    for warning in warnings:
        warn(warning)
    chunks = settings.chunks()
    begin(sum(len(part) for part in found.values()))
    missing = [number for number in range(len(chunks)) if number not in found]
    sessions = [i for number in missing for i in chunks[number]]
    with contextlib.closing(evaluated(settings, sessions, mesh, workers)) as rows:
        for number in missing:
            part = []
            for row in islice(rows, len(chunks[number])):
                part.append(row)
                done(1)
            found[number] = together(part)
            write_chunk(folder, number, found[number], settings)
    return together([found[number] for number in range(len(chunks))])


def evaluated(settings: StudySettings, sessions: list[int], mesh: Mesh, workers: int) -> Generator[Records, None, None]:
    """These sessions' rows in their order."""
    if not sessions:
        return
    length = settings.batch * mesh.size
    flying: deque[tuple[list[int], list[SessionArrays], SessionOutcome]] = deque()

    def land() -> Iterator[Records]:
        yield from _landed(settings, *flying[0])
        flying.popleft()

    with simulated(settings, sessions, workers, ahead=2 * length) as arrays:
        try:
            for first in range(0, len(sessions), length):
                numbers = sessions[first : first + length]
                own = list(islice(arrays, len(numbers)))
                # The last call is filled up with copies, which are thrown away: one shape, one program.
                stack = on_devices(stacked(own, length), mesh)
                flying.append((numbers, own, evaluate_sessions(stack, mesh, settings.side_by_side)))
                if len(flying) == IN_FLIGHT:
                    yield from land()
            while flying:
                yield from land()
        finally:
            # A process that ends while its devices compute may crash; when interrupted this takes seconds.
            jax.block_until_ready([outcome for _, _, outcome in flying])


def _landed(
    settings: StudySettings, numbers: list[int], arrays: list[SessionArrays], outcome: SessionOutcome
) -> Iterator[Records]:
    # Not `block_until_ready`, in which no signal is heard.
    while not all(leaf.is_ready() for leaf in jax.tree.leaves(outcome)):
        time.sleep(_LOOK_S)
    whole = jax.tree.map(np.asarray, outcome)
    for row, (number, own) in enumerate(zip(numbers, arrays, strict=True)):
        one = jax.tree.map(lambda x, row=row: x[row], whole)
        place = number % len(settings.regimes)
        yield record(number, settings.seed_of(number), place, settings.regime_of(number), own, one)
