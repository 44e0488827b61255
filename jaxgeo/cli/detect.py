"""`jaxgeo detect`: markers in images to the sightings that `jaxgeo run` reads, by a config or by options alone."""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from jaxgeo.cli.progress import Progress
from jaxgeo.config import load_config
from jaxgeo.config.images import ImagesSightingsInput
from jaxgeo.config.load import described
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Rig
from jaxgeo.errors import ConfigError
from jaxgeo.io.atomic import check_output_folder
from jaxgeo.io.frames.source import kind_of
from jaxgeo.io.rig_yaml import read_rig

CONFIG_SUFFIXES = (".yaml", ".yml")
# Where sightings are cut into visits for the pictures; a config says so itself.
GAP_S = 5.0


@dataclasses.dataclass(frozen=True)
class DetectOptions:
    """What the command line says in place of a config; None or empty: not said."""

    family: Sequence[str] = ()
    decoder: str | None = None
    hsv: str | None = None
    polarity: str | None = None
    rig: Path | None = None
    size_m: float | None = None
    stamps: Path | None = None
    rate_hz: float | None = None
    start_s: float | None = None
    camera: str | None = None
    topic: Sequence[str] = ()
    workers: int | None = None
    overlays: str | None = None

    def given(self) -> list[str]:
        """The options said, as they are written, of those that a config says too."""
        written = {"size_m": "--size", "rate_hz": "--rate", "start_s": "--start"}
        names = [field.name for field in dataclasses.fields(self) if field.name not in ("workers", "overlays")]
        return [written.get(name, f"--{name}") for name in names if getattr(self, name) not in (None, (), [])]


def detect_images(path: Path, out: Path | None, options: DetectOptions, overrides: Sequence[str], quiet: bool) -> None:
    """Detect in what `path` names (a session's config, a folder, a video or a bag), and write tables and pictures.

    Raises:
        JaxgeoError: bad input, or no marker in any image.
    """
    if path.suffix.lower() in CONFIG_SUFFIXES and not path.is_dir():
        if options.given():
            raise ConfigError(f"{', '.join(options.given())}: the config {path} says that itself; use --set KEY=VALUE.")
        config = load_config(path, overrides)
        images = images_of(config, path)
        rig, gap_s, label = rig_of(config), config.visits.gap_s, "SIMULATED " * config.simulated
        size_m, out = images.marker_size_m, Path("out") / config.name / "detections" if out is None else out
    else:
        if overrides:
            raise ConfigError("--set changes a config's values, but no config (.yaml) is given; use the options.")
        if out is None:
            raise ConfigError(f"--out is missing: the folder that the detections in {path} are to be written to.")
        images, gap_s, label = _from_options(path, options), GAP_S, ""
        rig = None if options.rig is None else read_rig(options.rig)
        size_m = None if options.size_m is None else images.marker_size_m
        if options.size_m is not None and rig is None:
            raise ConfigError("--size is for the markers' poses, which need a camera: give --rig too.")
    most = _most(options.overlays, images.overlays)
    if options.workers is not None:
        images = images.model_copy(update={"workers": options.workers})
    check_output_folder(out)
    with Progress(quiet) as progress:
        words = _detect(images, rig, size_m, out, progress, gap_s=gap_s, most=most, label=label)
    if not quiet:
        for warning in words[1:]:
            print(f"warning: {warning}", file=sys.stderr)
        print(words[0])


def images_of(config: SessionConfig, path: Path) -> ImagesSightingsInput:
    """The config's images.

    Raises:
        ConfigError: its sightings are of another kind.
    """
    if not isinstance(config.sightings, ImagesSightingsInput):
        raise ConfigError(
            f"{path}: sightings.kind is {config.sightings.kind!r}; jaxgeo detect looks for markers in images: expected "
            "'images', or give a folder, a video or a bag in the place of a config."
        )
    return config.sightings


def rig_of(config: SessionConfig) -> Rig:
    """The rig that the schema requires for images."""
    source = config.rig
    assert source is not None
    return read_rig(source.file if source.file is not None else source.model_dump(exclude_none=True))


def _detect(
    images: ImagesSightingsInput,
    rig: Rig | None,
    size_m: dict[str, float] | None,
    out: Path,
    progress: Progress,
    *,
    gap_s: float,
    most: int,
    label: str,
) -> tuple[str, ...]:
    """What to print at the end, then warnings."""
    from jaxgeo.cli.detected import detected_in_images
    from jaxgeo.cli.detection_pictures import write_pictures

    seen = detected_in_images(images, rig, size_m, out, progress)
    job, record, found = seen.job, seen.record, seen.found
    progress.phase("pictures")
    pictures = write_pictures(out, record.frames, job, found, marker_size_m=size_m, gap_s=gap_s, most=most, label=label)
    markers = len({*found.corners.marker.tolist()})
    poses = "" if found.sightings is None else f", {len(found.sightings)} poses"
    rate = (record.end or {}).get("images_per_s")
    speed = "" if record.reused else f" ({rate:.1f} images a second)"
    said = (
        f"{label}{len(found.corners)} sightings of {markers} markers in {len(record.frames)} images"
        f"{poses}, {pictures} overlays{speed}: {out}"
    )
    return (said, *found.warnings)


def _most(overlays: str | None, default: int) -> int:
    if overlays is None:
        return default
    if overlays == "all":
        return sys.maxsize
    if not overlays.isdecimal():
        raise ConfigError(f"--overlays {overlays!r}: expected a whole number, or all.")
    return int(overlays)


def _from_options(path: Path, options: DetectOptions) -> ImagesSightingsInput:
    """The same section that a config would have."""
    said = {
        "stamps": options.stamps,
        "rate_hz": options.rate_hz,
        "start_s": options.start_s,
        "camera": options.camera,
        "topics": dict(_topic(text) for text in options.topic) or None,
    }
    source = {"kind": kind_of(path), "path": path} | {key: value for key, value in said.items() if value is not None}
    values: dict[str, Any] = {"kind": "images", "source": source}
    values["marker_size_m"] = 1.0 if options.size_m is None else options.size_m
    if options.family:
        values["families"] = list(options.family)
    if options.decoder is not None:
        values["decoder"] = options.decoder
    if options.hsv is not None or options.polarity is not None:
        mask: dict[str, Any] = {} if options.hsv is None else {"hsv": _hsv(options.hsv)}
        values["mask"] = mask | ({} if options.polarity is None else {"polarity": options.polarity})
    try:
        return ImagesSightingsInput.model_validate(values)
    except ValidationError as error:
        raise ConfigError(f"{path}: {described(error)}") from None


def _topic(text: str) -> tuple[str, str]:
    topic, _, camera = text.partition("=")
    return topic, camera or "cam0"


def _hsv(text: str) -> Any:
    """`green`, or six numbers."""
    if not any(character.isdigit() for character in text):
        return text
    try:
        numbers = [int(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6:
        raise ConfigError(
            f"--hsv {text!r}: expected green, red, blue, or six whole numbers: the lowest and the highest H, S, V, as "
            "in 35,120,50,85,255,255."
        )
    return {"low": numbers[:3], "high": numbers[3:]}
