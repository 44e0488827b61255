"""A recording rendered by several processes, in the order of its stamps whatever their number."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool

import cv2

from jaxgeo.data.scan import Scan
from jaxgeo.errors import InputError
from jaxgeo.processes import WorkerPool
from jaxgeo.simulate.sensors.recording import EncodedFrame, Recording, Renderer, jobs

# So many jobs a process wait or are done: enough to keep it busy, few enough to keep in memory.
_AHEAD = 8
_renderer: Renderer | None = None


def rendered(recording: Recording, workers: int = 1) -> Iterator[Scan | EncodedFrame]:
    """All scans and frames by their stamps; with one worker in this process.

    Raises:
        InputError: a worker was killed: memory ran out.
    """
    if workers <= 1:
        renderer = Renderer(recording)
        yield from map(renderer.item, jobs(recording))
        return
    with WorkerPool(workers, _start, (recording,)) as pool:
        waiting: deque[Future[Scan | EncodedFrame]] = deque()
        try:
            for job in jobs(recording):
                waiting.append(pool.submit(_item, job))
                if len(waiting) >= _AHEAD * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BrokenProcessPool:
            raise InputError(
                f"a process that renders was killed; was there memory for {workers} of about 1 GB? Use fewer workers."
            ) from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _start(recording: Recording) -> None:
    global _renderer  # one world a process
    cv2.setNumThreads(1)  # the processes share the cores already
    _renderer = Renderer(recording)


def _item(job: tuple[int, int]) -> Scan | EncodedFrame:
    assert _renderer is not None
    return _renderer.item(job)
