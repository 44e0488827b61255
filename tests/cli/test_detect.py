"""`jaxgeo detect` and `jaxgeo run` on images: right poses, the same bytes after an interruption, clear refusals."""

import json
import re
import shutil

import cv2
import numpy as np
import pytest
from cli.small_images import FAMILY, HEIGHT, IDS, WIDTH, seen, true_scene, write_small_images

import jaxgeo.cli.detection_job as detection_job
from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.main import main
from jaxgeo.cli.progress import Progress
from jaxgeo.config import load_config
from jaxgeo.io import read_corner_sightings, read_pose_sightings, read_tum

TABLES = ("corners.csv", "sightings.csv")


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    write_small_images(folder)
    return folder


@pytest.fixture(scope="module")
def whole(images):
    """Outputs of an uninterrupted run."""
    out = images / "whole"
    assert main(["detect", str(images / "images.yaml"), "--out", str(out), "--quiet"]) == 0
    return out


def options(images, out, *more):
    """The same job without a config."""
    given = {"--family": FAMILY, "--stamps": "stamps.csv", "--rig": "rig_images.yaml", "--size": "0.3", "--out": out}
    files = ("--stamps", "--rig")
    words = [str(x) for key, value in given.items() for x in (key, images / value if key in files else value)]
    return ["detect", str(images / "images"), *words, *more]


def said(capsys, arguments, code):
    assert main(arguments) == code
    return capsys.readouterr().err


def test_poses_are_those_of_the_truth(whole):
    sightings = read_pose_sightings(whole / "sightings.csv")
    stamp_s, truth, marker_m = true_scene()
    assert len(sightings) == len(seen()) == 21
    for i, (row, name) in enumerate(seen()):
        assert sightings.stamp_s[i] == stamp_s[row]
        assert sightings.marker[i] == str(IDS[name])
        error_m = sightings.t_body_marker_m[i] - truth[row].inv().apply(marker_m[name])
        sigma_m = np.sqrt(np.trace(sightings.covariance[i, :3, :3]))
        assert np.linalg.norm(error_m) < min(0.03, 6 * sigma_m)


def test_corners_are_read_by_header_and_the_account_counts_them(whole):
    corners = read_corner_sightings(whole / "corners.csv")
    account = json.loads((whole / "detect.json").read_text())
    assert len(corners) == 21
    assert set(corners.camera) == {"cam0"}
    assert account["images"] == {
        "read": 21,
        "with_markers": 21,
        "unreadable": [],
        "first_stamp_s": corners.stamp_s[0],
        "last_stamp_s": corners.stamp_s[-1],
    }
    assert account["markers"][str(IDS["A"])] == 6
    assert account["families"] == {FAMILY: 21}
    assert account["poses"] == 21
    assert account["timing"]["images_per_s"] > 0


def test_pictures_are_there_one_for_every_visit(whole):
    assert len(list((whole / "overlays").iterdir())) == 7
    sheet = cv2.imread(str(whole / "contact_sheet.png"))
    assert sheet.shape[1] > 4 * 400


def test_options_find_what_the_config_finds(images, whole, tmp_path, capsys):
    assert main(options(images, tmp_path / "out", "--overlays", "2", "--workers", "2")) == 0
    for file in TABLES:
        assert (tmp_path / "out" / file).read_bytes() == (whole / file).read_bytes()
    assert len(list((tmp_path / "out" / "overlays").iterdir())) == 2
    assert "21 sightings of 6 markers in 21 images, 21 poses, 2 overlays" in capsys.readouterr().out


def test_without_rig_there_are_corners_and_no_poses(images, whole, tmp_path):
    given = ["--family", FAMILY, "--stamps", str(images / "stamps.csv"), "--quiet"]
    assert main(["detect", str(images / "images"), *given, "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "corners.csv").read_bytes() == (whole / "corners.csv").read_bytes()
    assert not (tmp_path / "out" / "sightings.csv").exists()


def stop_after(monkeypatch, count):
    """Images end with Ctrl-C after so many; the number of images asked for is in the list returned."""
    asked = []
    detected = detection_job._detected

    def frames(job, source):
        for frame in detected(job, source):
            if len(asked) == count:
                raise KeyboardInterrupt
            asked.append(frame.index)
            yield frame

    monkeypatch.setattr(detection_job, "_detected", frames)
    return asked


def test_an_interrupted_job_goes_on_and_ends_with_the_same_bytes(images, whole, tmp_path, monkeypatch, capsys):
    arguments = ["detect", str(images / "images.yaml"), "--out", str(tmp_path)]
    with monkeypatch.context() as context:
        assert stop_after(context, 8) == []
        assert main(arguments) == 130
    assert not (tmp_path / "corners.csv").exists()
    record = tmp_path / detection_job.RECORD_FILE
    record.write_bytes(record.read_bytes()[:-40])  # killed within a line
    with monkeypatch.context() as context:
        asked = stop_after(context, 100)
        err = said(capsys, arguments, 0)
    assert asked == list(range(7, 21))
    assert "going on after 7 images" in err
    for file in TABLES:
        assert (tmp_path / file).read_bytes() == (whole / file).read_bytes()
    accounts = [json.loads((folder / "detect.json").read_text()) for folder in (tmp_path, whole)]
    assert [account.pop("timing") is not None for account in accounts] == [True, True]
    assert accounts[0] == accounts[1]
    assert "unchanged, 21 images used as they are" in said(capsys, arguments, 0)


def test_other_settings_or_images_start_anew(images, tmp_path, monkeypatch, capsys):
    again = tmp_path / "images"
    shutil.copytree(images / "images", again)
    shutil.copy(images / "stamps.csv", tmp_path)
    given = ["--stamps", str(tmp_path / "stamps.csv"), "--family", FAMILY, "--out", str(tmp_path / "out")]
    arguments = ["detect", str(again), *given]
    assert main(arguments) == 0
    assert "unchanged, 21 images used as they are" in said(capsys, arguments, 0)
    asked = stop_after(monkeypatch, 1000)
    assert main([*arguments, "--family", "4x4_50"]) == 0
    assert len(asked) == 21
    assert read_corner_sightings(tmp_path / "out" / "corners.csv").marker[0] == f"{FAMILY}:{IDS['A']}"
    shutil.copy(again / "001.png", again / "000.png")
    assert main([*arguments, "--family", "4x4_50"]) == 0
    assert len(asked) == 42


def test_an_unreadable_image_is_counted_and_named(images, tmp_path, capsys):
    again = tmp_path / "images"
    shutil.copytree(images / "images", again)
    (again / "004.png").write_bytes(b"no image")
    given = ["--stamps", str(images / "stamps.csv"), "--family", FAMILY, "--out", str(tmp_path / "out")]
    err = said(capsys, ["detect", str(again), *given], 0)
    assert "1 image could not be read and left out" in err
    assert "004.png" in err
    account = json.loads((tmp_path / "out" / "detect.json").read_text())
    assert account["images"]["read"] == 20
    assert len(account["images"]["unreadable"]) == 1


def test_run_detects_first_and_uses_what_it_found_again(images, tmp_path, capsys):
    path = images / "images.yaml"
    err = said(capsys, ["run", str(path), "--out", str(tmp_path), "--set", "report.interactive=false"], 0)
    assert re.search(r"^detect .*images +\d", err, re.MULTILINE)
    assert (tmp_path / "detections" / "sightings.csv").exists()
    run = json.loads((tmp_path / "run.json").read_text())
    assert any(name.endswith("corners.csv") for name in run["inputs_sha256"])
    found, truth = read_tum(tmp_path / "trajectory.tum"), read_tum(images / "truth.tum")
    visited = [row for row, _ in seen()]
    truth_m = truth.position_m[visited] - np.array(run["frame"]["origin_enh_m"])
    assert np.linalg.norm(found.position_m[visited] - truth_m, axis=1).max() < 0.10
    with Progress() as progress:
        again = ingest(load_config(path), progress, tmp_path)
    assert "21 images used as they are" in capsys.readouterr().err
    assert len(again.visits) == 7


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["detect", "nowhere", "--out", "out"], "nowhere: no such file or folder"),
        (["detect", "images"], "--out is missing"),
        (["detect", "images", "--out", "images", "--rate", "1"], "would lie among the images"),
        (["detect", "images", "--out", "out", "--rate", "1", "--family", "aruco_mip_36h21"], "aruco_mip_36h12"),
        (["detect", "images", "--out", "out", "--rate", "1", "--size", "0.3"], "give --rig too"),
        (["detect", "images", "--out", "out", "--set", "a=1"], "no config"),
        (["detect", "images", "--out", "out", "--rate", "1", "--hsv", "1,2,3"], "expected green, red, blue, or six"),
        (["detect", "images", "--out", "out", "--rate", "1", "--overlays", "few"], "a whole number, or all"),
        (["detect", "images", "--out", "out", "--rate", "1", "--topic", "/a=b"], "'topics' says nothing about"),
        (["detect", "images.yaml", "--family", "4x4_50"], "--family: the config"),
        (["detect", "corners.yaml"], "sightings.kind is 'corners'"),
        (["detect", "broken.mp4", "--out", "out"], "broken.mp4"),
        (["run", "images.yaml", "--set", "rig=null"], "sightings of kind 'images' are pixels and need a camera"),
        (["run", "images.yaml", "--set", "sightings.source.path=gone"], "gone"),
        (["run", "images.yaml", "--set", "sightings.source.kind=video"], "'stamps' says nothing about"),
        (["run", "images.yaml", "--set", "sightings.mask=purple"], "sightings.mask.hsv"),
        (["run", "images.yaml", "--set", "sightings.gates.min_margin=2"], "min_margin is 2"),
    ],
)
def test_refusals(images, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(images)
    (images / "broken.mp4").write_bytes(b"not a video")
    err = said(capsys, arguments, 2)
    assert says in err
    assert err.count("error: ") == 1


def test_images_of_another_size_than_the_rigs_are_refused(images, tmp_path, capsys):
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "1.0.png"), np.zeros((HEIGHT, WIDTH // 2), np.uint8))
    rig = ["--rig", str(images / "rig_images.yaml"), "--out", str(tmp_path / "out"), "--rate", "1"]
    err = said(capsys, ["detect", str(tmp_path / "images"), *rig], 2)
    assert f"{WIDTH // 2} x {HEIGHT} px" in err
    assert f"[{WIDTH}, {HEIGHT}]" in err


def test_no_marker_anywhere_says_what_was_tried(images, tmp_path, capsys):
    given = ["--stamps", str(images / "stamps.csv"), "--family", "4x4_50", "--out", str(tmp_path)]
    err = said(capsys, ["detect", str(images / "images"), *given], 2)
    assert "no marker in 21 images; families 4x4_50; without a mask" in err
    assert not (tmp_path / "corners.csv").exists()
