"""Sound inputs for the commands that faults are put to: small sessions, images, bags, databases."""

import functools
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.fault_case import ROOT, Change, copied

# Writers of small sessions, bags and databases: the tests', so that there is one of each.
_TESTS = ROOT / "tests"
sys.path += [str(folder) for folder in (_TESTS, _TESTS / "io", _TESTS / "cli") if str(folder) not in sys.path]


@functools.cache
def session() -> Change:
    """The small session of the tests: configs poses, corners, stops and truth, and what they read."""
    from cli.small_session import write_small_session

    folder = _folder()
    write_small_session(folder)
    return copied(folder)


@functools.cache
def images() -> Change:
    """The small session with 21 images of markers, their stamps and rig: images.yaml."""
    from cli.small_images import write_small_images

    folder = _folder()
    write_small_images(folder)
    return copied(folder)


@functools.cache
def photographs() -> Change:
    """Two of the small session's images alone, as PNG and as JPEG, in a folder."""
    import cv2
    from cli.small_images import picture, seen, true_scene

    folder = _folder() / "work"
    (folder / "images").mkdir(parents=True)
    _, truth, marker_m = true_scene()
    for number, (row, name) in enumerate(seen()[:2]):
        image = picture(truth, marker_m, row, name, seed=number)
        cv2.imwrite(str(folder / "images" / f"{number:03d}{('.png', '.jpg')[number]}"), image)
    return copied(folder)


@functools.cache
def bag(kind: str) -> Change:
    """Six images of markers in a bag: `images.bag`, or the folders `images_sqlite3` and `images_mcap`."""
    from bags import RawImage, write_bag
    from cli.small_images import picture, seen, true_scene

    folder = _folder()
    _, truth, marker_m = true_scene()
    pictures = [picture(truth, marker_m, row, name, seed=number) for number, (row, name) in enumerate(seen()[:6])]
    items = [RawImage("/camera", (i + 1) * 10**8, pixels) for i, pixels in enumerate(pictures)]
    write_bag(folder, kind, [*items])
    return copied(folder)


@functools.cache
def database() -> Change:
    """A small RTAB-Map database, `map.db`: four nodes with images and their camera."""
    from rtabmap_database import IDENTITY, SmallDatabase, camera_blob, encoded

    folder = _folder()
    with SmallDatabase(folder / "map.db") as db:
        for node in range(1, 5):
            pose = IDENTITY.copy()
            pose[0, 3] = node
            db.node(node, pose)
            db.data(node, image=encoded(np.full((48, 64, 3), 10 * node, np.uint8)), calibration=camera_blob((64, 48)))
            if node > 1:
                db.link(node - 1, node, 0)
    return copied(folder)


def _folder() -> Path:
    """A folder that lasts as long as this process."""
    _KEPT.append(tempfile.TemporaryDirectory(prefix="faults-inputs-"))
    return Path(_KEPT[-1].name)


_KEPT: list[tempfile.TemporaryDirectory[str]] = []
