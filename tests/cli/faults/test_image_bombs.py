"""Images that claim more pixels than memory holds are refused by their head."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from jaxgeo.io.frames.frame import UnreadableImageError
from jaxgeo.io.frames.image_size import claimed_size, missing_bytes
from jaxgeo.io.frames.pixels import decoded_image


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif"])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (7, 300), (640, 481)])
def test_the_size_is_that_of_the_decoder(suffix: str, width: int, height: int) -> None:
    data = cv2.imencode(suffix, np.full((height, width, 3), 9, np.uint8))[1].tobytes()
    assert claimed_size(data) == (width, height)
    for end in range(0, min(len(data), 200), 7):  # cut off in the head: nothing claimed, or what is claimed already
        assert claimed_size(data[:end]) in (None, (width, height))


def test_a_png_of_a_gigapixel_is_refused_before_it_is_decoded() -> None:
    head = struct.pack(">2I5B", 30_000, 30_000, 8, 0, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(bytes(30_001))), (b"IEND", b"")]
    chunks = [struct.pack(">I", len(c)) + kind + c + struct.pack(">I", zlib.crc32(kind + c)) for kind, c in parts]
    with pytest.raises(UnreadableImageError, match=r"bomb\.png: claims 30000 x 30000 pixels, expected at most"):
        decoded_image(b"\x89PNG\r\n\x1a\n" + b"".join(chunks), "bomb.png")


def test_a_png_chunk_longer_than_the_file_is_refused_before_memory_is_asked_for() -> None:
    data = cv2.imencode(".png", np.full((30, 40, 3), 9, np.uint8))[1].tobytes()
    at = data.index(b"IDAT") - 4
    bomb = data[:at] + struct.pack(">I", 0x7FFFFFFF) + data[at + 4 :]
    with pytest.raises(UnreadableImageError, match=r"bomb\.png: \d+ bytes, of which the last part claims 2147\d+ more"):
        decoded_image(bomb, "bomb.png")
    assert missing_bytes(data) == missing_bytes(data + b"behind the end") == 0
    assert missing_bytes(data[:-1]) == 1


@pytest.mark.parametrize("size", [(65_500, 65_500), (0xFFFF, 0x2000)])
def test_so_is_a_jpeg(size: tuple[int, int]) -> None:
    data = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    at = data.index(b"\xff\xc0")
    bomb = data[: at + 5] + struct.pack(">2H", size[1], size[0]) + data[at + 9 :]
    with pytest.raises(UnreadableImageError, match=f"claims {size[0]} x {size[1]} pixels"):
        decoded_image(bomb, "bomb.jpg")
