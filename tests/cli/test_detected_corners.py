"""Detections as tables and as the job's own record: order, names, and every digit kept."""

import numpy as np
import pytest

from jaxgeo.cli.detected_corners import corner_sightings, marker_sources, sigma_px, write_corners
from jaxgeo.cli.detection_record import DetectionRecord, FrameRecord
from jaxgeo.detect.detection import Detections
from jaxgeo.io import read_corner_sightings


def found(rng, markers, family="apriltag_36h11"):
    count = len(markers)
    root = rng.normal(size=(count, 8, 8)) / 10
    return Detections(
        family=np.full(count, family),
        marker=np.array(markers, dtype=np.int64),
        corners_px=rng.uniform(10, 20, (count, 1, 2)) + 30 * np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]]) + 1 / 3,
        covariance_px2=root @ np.swapaxes(root, 1, 2),
        hamming=np.zeros(count, dtype=np.int64),
        margin=rng.uniform(size=count),
    )


@pytest.fixture
def frames():
    """Stamps out of order, an image without markers, one marker twice in an image."""
    rng = np.random.default_rng(3)
    markers = [[7], [], [2, 2], [5, 7]]
    stamps = [3.25, 0.5, 2.125, 1.0 + 1e-9]
    return [
        FrameRecord(i, stamp, "cam0", f"{i}.png", found(rng, ids), {"margin": i}, ("gone",) * (i == 2))
        for i, (stamp, ids) in enumerate(zip(stamps, markers, strict=True))
    ]


def test_sightings_are_in_the_order_of_time(frames):
    sightings = corner_sightings(frames, several_families=False, time_offset_s=10.0)
    np.testing.assert_array_equal(sightings.stamp_s, [11.0 + 1e-9, 11.0 + 1e-9, 12.125, 12.125, 13.25])
    assert sightings.marker.tolist() == ["5", "7", "2", "2", "7"]
    assert len(set(sightings.source.tolist())) == 5
    assert sightings.source[3] == "2.png: marker 2 (2)"
    np.testing.assert_array_equal(sightings.corners_px[4], frames[0].found.corners_px[0])
    np.testing.assert_array_equal(sightings.covariance_px2[4], frames[0].found.covariance_px2[0])


def test_several_families_name_theirs(frames):
    assert marker_sources(frames[0], True) == ["0.png: marker apriltag_36h11:7"]
    assert corner_sightings(frames, True).marker[0] == "apriltag_36h11:5"


def test_the_table_is_what_the_sightings_are(frames, tmp_path):
    path = tmp_path / "corners.csv"
    write_corners(path, frames, several_families=False, time_offset_s=10.0)
    table, sightings = read_corner_sightings(path), corner_sightings(frames, False, 10.0)
    for field in ("stamp_s", "camera", "marker", "corners_px"):
        np.testing.assert_array_equal(getattr(table, field), getattr(sightings, field))
    lines = path.read_text().splitlines()
    assert lines[0].endswith("v3,sigma_px,family,hamming,margin")
    assert [line.split(",")[0] for line in lines[1:]] == [repr(stamp) for stamp in sightings.stamp_s.tolist()]
    sigmas = [float(line.split(",")[11]) for line in lines[1:]]
    np.testing.assert_array_equal(sigmas, sigma_px(sightings.covariance_px2))


def test_sigma_is_that_of_equal_coordinates():
    np.testing.assert_allclose(sigma_px(0.3**2 * np.eye(8)[None]), [0.3])


def test_a_record_keeps_every_digit_and_knows_its_end(frames, tmp_path):
    path = tmp_path / "detections.jsonl"
    with DetectionRecord(path, "key") as record:
        for frame in frames[:2]:
            record.append(frame)
    with DetectionRecord(path, "key") as record:
        assert (record.resumed, record.end) == (2, None)
        for frame in frames[2:]:
            record.append(frame)
        record.finish({"unreadable": []})
    with DetectionRecord(path, "key") as record:
        assert (record.resumed, record.end, record.reused) == (4, {"unreadable": []}, True)
        for kept, frame in zip(record.frames, frames, strict=True):
            for field in ("index", "stamp_s", "camera", "source", "refused", "unreadable"):
                assert getattr(kept, field) == getattr(frame, field)
            np.testing.assert_array_equal(kept.found.corners_px, frame.found.corners_px)
            np.testing.assert_allclose(kept.found.covariance_px2, frame.found.covariance_px2, rtol=1e-15, atol=1e-18)
            np.testing.assert_array_equal(kept.found.margin, frame.found.margin)
    with DetectionRecord(path, "another key") as record:
        assert record.frames == []
