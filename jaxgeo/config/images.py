"""Sightings of kind `images`: where the images come from, and which markers to look for in them."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from jaxgeo.config.fields import InputFile, MarkerSizes, Name, NonNegative, Positive, Section

Byte = Annotated[int, Field(ge=0, le=255)]
SOURCE_KEYS = {
    "folder": ("stamps", "rate_hz", "start_s", "camera"),
    "video": ("rate_hz", "start_s", "camera"),
    "bag": ("topics", "camera"),
}


def _triple(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("expected three whole numbers [H, S, V], hue 0 to 179, the others 0 to 255")
    return tuple(value)


Hsv = Annotated[tuple[Annotated[int, Field(ge=0, le=179)], Byte, Byte], BeforeValidator(_triple)]


class ImageSourceInput(Section):
    """Images: a folder, a video file or a ROS bag.

    Attributes:
        stamps: of a folder: a table of stamps and file names; without one, stamps in the file names are read.
        rate_hz: images a second, where nothing has stamps; of a video, in the place of its own times.
        start_s: the stamp of the first image (with `rate_hz`), or of a video's start.
        camera: the rig's camera that took all images; by default the only one of the rig, or `cam0`.
        topics: of a bag: topic -> camera of the rig.
    """

    kind: Literal["folder", "video", "bag"]
    path: InputFile = Field(description="the folder of images, the video file, or the bag")
    stamps: InputFile | None = None
    rate_hz: Positive | None = None
    start_s: float | None = None
    camera: Name | None = None
    topics: dict[str, Name] | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _check_keys_of_kind(self):
        for key in ("stamps", "rate_hz", "start_s", "camera", "topics"):
            if getattr(self, key) is not None and key not in SOURCE_KEYS[self.kind]:
                known = ", ".join(SOURCE_KEYS[self.kind])
                raise ValueError(f"{key!r} says nothing about a source of kind {self.kind!r} (which has {known})")
        if self.stamps is not None and self.rate_hz is not None:
            raise ValueError("'stamps' and 'rate_hz' both say when images were taken: remove one")
        if self.kind == "folder" and self.start_s is not None and self.rate_hz is None:
            raise ValueError("'start_s' is the stamp of the first of images at 'rate_hz': give that too, or remove it")
        return self


class HsvRangeInput(Section):
    """Colours as OpenCV counts them: H 0 to 179, S and V 0 to 255, both ends included; hue wraps where low > high."""

    low: Hsv = Field(description="lowest [H, S, V]")
    high: Hsv = Field(description="highest [H, S, V]")


COLOURS = ("green", "red", "blue")


def _colour(value: Any) -> Any:
    """The range that a colour's name stands for."""
    if not isinstance(value, str):
        return value
    if value not in COLOURS:
        raise ValueError(f"expected {', '.join(COLOURS)}, or a range: {{low: [H, S, V], high: [H, S, V]}}")
    from jaxgeo.detect import mask  # a config without masks should not wait for image processing

    preset = getattr(mask, value.upper())
    return {"low": [int(x) for x in preset.low], "high": [int(x) for x in preset.high]}


class MaskInput(Section):
    """Where the markers' colour isolates them.

    Attributes:
        hsv: green, red or blue, or a range; the config that is written out has the range.
        polarity: `marker`: the code's dark cells are inside the range; `ground`: its light cells and surroundings are;
            `auto`: both are tried.
        open_px, close_px: morphology: specks up to so large go, holes up to so large are filled; 0: none.
    """

    hsv: Annotated[HsvRangeInput, BeforeValidator(_colour)] = Field(default="green", validate_default=True)
    polarity: Literal["auto", "marker", "ground"] = "auto"
    open_px: Annotated[int, Field(ge=0, le=99)] | None = None
    close_px: Annotated[int, Field(ge=0, le=99)] | None = None


class GatesInput(Section):
    """Limits that replace the defaults of `jaxgeo.detect.gates.Gates`, which checks them; None leaves the default."""

    max_hamming: Annotated[int, Field(ge=0)] | None = None
    min_margin: NonNegative | None = None
    max_border_errors: NonNegative | None = None
    min_contrast: NonNegative | None = None
    min_side_px: Positive | None = None
    max_view_angle_rad: Positive | None = None
    plain_margin: NonNegative | None = None
    ids: list[Annotated[int, Field(ge=0)]] | None = Field(default=None, min_length=1)


def _mask(value: Any) -> Any:
    return {"hsv": value} if isinstance(value, str) else value


class ImagesSightingsInput(Section):
    """Markers detected in images by this run itself; needs a rig.

    Attributes:
        marker_size_m: side by marker id, `default` for all others; one number for all. With several families an id is
            written `family:id`.
        families: OpenCV's names of dictionaries in lower case.
        decoder: what finds the candidates of printed markers: opencv; kornia (AprilTags only, faster, misses more small
            ones); both.
        mask: of markers that their colour isolates (iMarkers); none for printed markers.
        time_offset_s: added to the images' stamps.
        workers: processes that detect.
        overlays: pictures of detections, at most so many.
    """

    kind: Literal["images"]
    source: ImageSourceInput = Field(description="where the images come from: {kind: folder, path: .., ..}")
    marker_size_m: MarkerSizes = Field(description="the side of the markers, one number or {default: .., id: ..}")
    families: list[Name] = Field(default=["apriltag_36h11"], min_length=1)
    decoder: Literal["opencv", "kornia", "both"] = "opencv"
    mask: Annotated[MaskInput | None, BeforeValidator(_mask)] = None
    gates: GatesInput = GatesInput()
    time_offset_s: float = 0.0
    pixel_sigma_px: Positive = 1.0
    workers: Annotated[int, Field(ge=1, le=256)] = 1
    overlays: Annotated[int, Field(ge=0)] = 12
