"""`jaxgeo detect --tune`: a range to paste, a picture, a file."""

import json

import cv2
import numpy as np

from jaxgeo.cli.main import main


def labelled(folder):
    rng = np.random.default_rng(0)
    image = rng.integers(60, 120, (60, 80, 1), dtype=np.uint8).repeat(3, axis=2)
    image[20:40, 30:50] = (60, 190, 50)
    mask = np.zeros((60, 80), np.uint8)
    mask[20:40, 30:50] = 255
    assert cv2.imwrite(str(folder / "a.png"), image)
    assert cv2.imwrite(str(folder / "a.mask.png"), mask)


def test_the_range_is_printed_and_written(tmp_path, capsys):
    labelled(tmp_path)
    out = tmp_path / "out"
    assert main(["detect", str(tmp_path), "--tune", "--hsv", "100,10,10,140,255,255", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    facts = json.loads((out / "tune.json").read_text())
    assert f"hsv: {{low: {facts['hsv']['low']}, high: {facts['hsv']['high']}}}" in said
    assert facts["overlap_before"] < 0.1 < 0.99 < facts["overlap_after"]
    assert cv2.imread(str(out / "tune.png")).shape[1] == 3 * 426


def test_bad_input_is_one_message(tmp_path, capsys):
    assert main(["detect", str(tmp_path), "--tune"]) == 2
    assert "no labelled image" in capsys.readouterr().err
    labelled(tmp_path)
    assert main(["detect", str(tmp_path), "--tune", "--hsv", "1,2,3"]) == 2
    assert "six whole numbers" in capsys.readouterr().err
