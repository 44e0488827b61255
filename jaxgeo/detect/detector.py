"""One image to detections: candidates, refined corners, read codes, gates."""

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Protocol

import cv2
import jax
import numpy as np
from jaxtyping import Float, Num, UInt8

from jaxgeo.data import Camera
from jaxgeo.detect.channel import best_mix, mixed, white_cells
from jaxgeo.detect.code_edges import refine_with_code
from jaxgeo.detect.detection import Detections, no_detections
from jaxgeo.detect.edges import Corners, refine_corners
from jaxgeo.detect.families import Family, family, family_name
from jaxgeo.detect.gates import Gates, refusals
from jaxgeo.detect.kornia_quads import KorniaQuads
from jaxgeo.detect.lens import of_crop
from jaxgeo.detect.mask import MaskSettings, soft_mask
from jaxgeo.detect.quads import OpenCVQuads, mask_quads
from jaxgeo.detect.reading import (
    Readings,
    cell_points,
    covariance_in_print_order,
    in_print_order,
    levels_at,
    read_cells,
    read_codes,
    rings,
)
from jaxgeo.detect.regions import find_regions
from jaxgeo.detect.second_look import ENLARGED, failed_places, from_enlarged
from jaxgeo.errors import DetectError

# Of corners whose sides could not be followed: thresholded ones are off by so many pixels.
_UNREFINED_PX = 1.0

# How much more a marker's border lies inside the mask than its surroundings, of 255.
_RIM_LEVELS = 40.0

DECODERS = ("opencv", "kornia", "both")


@dataclasses.dataclass(frozen=True)
class DetectorSettings:
    """What to look for.

    Attributes:
        families: names as in `families.FAMILIES`, one or several.
        decoder: what finds the candidates of printed markers: `opencv`, `kornia` (AprilTags only, faster, misses more
            small ones) or `both`. Masks find theirs by their outlines.
        mask: where the markers' colour isolates them (iMarkers); None for printed markers.
        gates: what a reading must satisfy.
    """

    families: tuple[str, ...] = ("apriltag_36h11",)
    mask: MaskSettings | None = None
    gates: Gates = dataclasses.field(default_factory=Gates)
    decoder: str = "opencv"

    def __post_init__(self) -> None:
        if self.decoder not in DECODERS:
            raise DetectError(f"decoder {self.decoder!r} is not known; expected one of {', '.join(DECODERS)}.")
        if not self.families:
            raise DetectError("no marker family is given; expected at least one, for example apriltag_36h11.")
        object.__setattr__(self, "families", tuple(dict.fromkeys(family_name(name) for name in self.families)))


class QuadFinder(Protocol):
    """A decoder's part: outlines that may hold a code, clockwise as seen."""

    def __call__(self, gray: UInt8[np.ndarray, "h w"], /) -> Float[np.ndarray, "q 4 2"]: ...


class Detector:
    """Markers of one image after another. Not for several threads at once.

    Attributes:
        refused: by gate, how many candidates nearly read as a marker and were turned down so far.
    """

    def __init__(self, settings: DetectorSettings):
        self.settings = settings
        self.refused: Counter[str] = Counter()
        chosen = [family(name) for name in settings.families]
        self._groups = [[f for f in chosen if f.cells == n] for n in sorted({f.cells for f in chosen})]
        self._finders: list[QuadFinder] = []
        if settings.decoder != "kornia":
            self._finders.append(OpenCVQuads(settings.families[0], settings.gates.min_side_px))
        if settings.decoder != "opencv":
            self._finders.append(KorniaQuads(settings.families))

    def __call__(self, image: UInt8[np.ndarray, "h w ..."], camera: Camera | None = None) -> Detections:
        """Markers in one image: BGR (h, w, 3) or gray (h, w), bytes.

        With the camera known, the bend that its lens gives to long edges is no error of the corners.

        Raises:
            DetectError: an image of another kind; a gray one where a mask is to find colour.
        """
        _check(image, self.settings)
        mask = self.settings.mask
        found = list(self._printed(image, camera) if mask is None else self._masked(image, mask, camera))
        return distinct(found) if found else no_detections()

    def _printed(self, image: UInt8[np.ndarray, "h w ..."], camera: Camera | None) -> Iterator[Detections]:
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        quads, found = self._whole(gray, of_crop(camera, 0, 0))
        yield from found
        known = np.concatenate([one.corners_px for one in found]) if found else np.zeros((0, 4, 2))
        for x0, y0, x1, y1 in failed_places(quads, known, gray.shape):
            crop = cv2.resize(gray[y0:y1, x0:x1], None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
            for one in self._whole(crop, of_crop(camera, x0, y0, ENLARGED), ENLARGED)[1]:
                yield dataclasses.replace(
                    one,
                    corners_px=from_enlarged(one.corners_px, x0, y0),
                    covariance_px2=one.covariance_px2 / ENLARGED**2,
                )

    def _whole(
        self, gray: UInt8[np.ndarray, "h w"], lens: Camera | None, enlarged: int = 1
    ) -> tuple[Float[np.ndarray, "q 4 2"], list[Detections]]:
        """All candidate outlines of an image, and what they read as: better corners first."""
        quads = np.concatenate([find(gray) for find in self._finders])
        found = []
        for group in self._groups if len(quads) else ():
            refined = refine_corners(gray, quads, group[0].cells, rounds=2)
            found.append(self._read(gray, refined.corners_px, group, lens, enlarged))
            # Where blur and neighbours lead the sides astray, the thresholded outline may still read.
            found.append(self._read(gray, quads, group, lens, enlarged))
        return quads, found

    def _masked(
        self, bgr: UInt8[np.ndarray, "h w 3"], mask: MaskSettings, camera: Camera | None
    ) -> Iterator[Detections]:
        for x0, y0, x1, y1 in find_regions(bgr, mask):
            crop = bgr[y0:y1, x0:x1]
            inside = soft_mask(crop, mask.hsv)
            for polarity, reflector in (("marker", inside), ("ground", cv2.bitwise_not(inside))):
                if mask.polarity not in ("auto", polarity):
                    continue
                quads = mask_quads(reflector, self.settings.gates.min_side_px, outer=polarity == "marker")
                found = [
                    _moved(one, x0, y0)
                    for group in (self._groups if len(quads) else ())
                    for one in self._in_colour(crop, reflector, quads, group, of_crop(camera, x0, y0))
                ]
                yield from found
                if found:
                    break

    def _in_colour(
        self,
        crop: UInt8[np.ndarray, "h w 3"],
        reflector: UInt8[np.ndarray, "h w"],
        quads: Float[np.ndarray, "q 4 2"],
        group: Sequence[Family],
        lens: Camera | None,
    ) -> Iterator[Detections]:
        """Read codes in the colour that parts each marker's border best from its surroundings.

        A mix of colours is linear, so cells are mixed, not images; only the corners of what was read need an image.
        Where the mask's outline is too rough to read by, its sides are followed first.
        """
        n = group[0].cells
        around, border = rings(n)
        points = cell_points(quads, n)
        levels = levels_at(reflector, points, n)
        rimmed = levels[:, border].mean(axis=1) - levels[:, around].mean(axis=1) > _RIM_LEVELS
        if not np.any(rimmed):
            return
        for quad, cells in zip(quads[rimmed], levels_at(crop, points[rimmed], n), strict=True):
            mix = best_mix(cells, around, border)
            outline, reading = quad[None], read_cells((cells @ mix.weights + mix.offset)[None], group)
            if reading.hamming[0] > group[reading.family[0]].max_hamming:
                outline = refine_corners(mixed(crop, mix), outline, n, rounds=2).corners_px
                cells = levels_at(crop, cell_points(outline, n), n)[0]
                reading = read_cells((cells @ mix.weights + mix.offset)[None], group)
            one = group[reading.family[0]]
            if reading.hamming[0] > one.max_hamming:
                continue
            # The code known, all its cells say what the best mix is.
            white = white_cells(int(one.codes[reading.marker[0], reading.quarter_turns[0]]), n)
            mix = best_mix(cells, white, ~white)
            channel = mixed(crop, mix)
            if reading.hamming[0] > 0:
                outline = _refined(channel, outline[0], white, lens).corners_px
                reading = read_codes(channel, outline, [one])
            else:
                reading = reading._replace(family=np.zeros(1, dtype=np.int64))
            found = self._passing(channel, outline, reading, [one], lens)
            if len(found):
                yield found

    def _read(
        self,
        gray: Num[np.ndarray, "h w"],
        outlines_px: Float[np.ndarray, "q 4 2"],
        group: Sequence[Family],
        lens: Camera | None,
        enlarged: int = 1,
    ) -> Detections:
        return self._passing(gray, outlines_px, read_codes(gray, outlines_px, group), group, lens, enlarged)

    def _passing(
        self,
        gray: Num[np.ndarray, "h w"],
        outlines_px: Float[np.ndarray, "q 4 2"],
        readings: Readings,
        group: Sequence[Family],
        lens: Camera | None,
        enlarged: int = 1,
    ) -> Detections:
        """What passes the gates, its corners refined with all edges of its code."""
        refused = refusals(readings, outlines_px / enlarged, group, self.settings.gates)
        rows = np.flatnonzero(~np.any(np.stack(list(refused.values())), axis=0))
        near = ~refused["hamming"]
        self.refused.update({gate: int(np.count_nonzero(near & one)) for gate, one in refused.items()})
        if not len(rows):
            return no_detections()
        chosen = [group[f] for f in readings.family[rows]]
        marker, turns = readings.marker[rows], readings.quarter_turns[rows]
        codes = [f.codes[m, t] for f, m, t in zip(chosen, marker, turns, strict=True)]
        refined = [
            _refined(gray, outlines_px[row], white_cells(int(code), f.cells), lens)
            for row, code, f in zip(rows, codes, chosen, strict=True)
        ]
        corners = np.stack([one.corners_px[0] for one in refined])
        covariance = np.stack([one.covariance_px2[0] for one in refined])
        return Detections(
            family=np.array([f.name for f in chosen], dtype=str),
            marker=marker,
            corners_px=in_print_order(corners, turns),
            covariance_px2=covariance_in_print_order(covariance, turns),
            hamming=readings.hamming[rows],
            margin=readings.margin[rows],
        )


def _refined(
    gray: Num[np.ndarray, "h w"], outline_px: Float[np.ndarray, "4 2"], white: np.ndarray, lens: Camera | None
) -> Corners:
    """By all edges of the code; else by the sides; else as found, with what a thresholded corner is worth."""
    refined = refine_with_code(gray, outline_px, white, lens)
    if not refined.ok[0]:
        refined = refine_corners(gray, outline_px[None], len(white) - 4, rounds=2)
    if refined.ok[0]:
        return refined
    return Corners(outline_px[None], _UNREFINED_PX**2 * np.eye(8)[None], np.array([True]))


def distinct(found: Sequence[Detections]) -> Detections:
    """One detection of each marker at a place: earlier groups first, then fewest corrected bits, then the clearest."""
    found = [group for group in found if len(group)] or [found[0]]
    if len(found) == 1 and len(found[0]) < 2:
        return found[0]
    rank = np.concatenate([np.full(len(group), i) for i, group in enumerate(found)])
    joined = jax.tree.map(lambda *columns: np.concatenate(columns), *found)
    centre = joined.corners_px.mean(axis=1)
    size = np.linalg.norm(joined.corners_px[:, 2] - joined.corners_px[:, 0], axis=1)
    kept: list[int] = []
    for row in np.lexsort((-joined.margin, joined.hamming, rank)):
        apart = np.linalg.norm(centre[kept] - centre[row], axis=1) > 0.25 * np.minimum(size[kept], size[row])
        if np.all(apart):
            kept.append(int(row))
    rows = np.sort(np.array(kept, dtype=np.int64))
    return jax.tree.map(lambda column: column[rows], joined)


def _moved(found: Detections, x0: int, y0: int) -> Detections:
    return dataclasses.replace(found, corners_px=found.corners_px + np.array([x0, y0], dtype=np.float64))


def _check(image: np.ndarray, settings: DetectorSettings) -> None:
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise DetectError(
            f"an image of shape {image.shape} and type {image.dtype}; expected bytes, (h, w) gray or (h, w, 3) BGR."
        )
    if settings.mask is not None and image.ndim == 2:
        raise DetectError("a gray image, but a mask needs colour: leave the mask out, or give colour images.")
