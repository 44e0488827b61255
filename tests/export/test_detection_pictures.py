"""Overlays and contact sheets: what is drawn lies where the camera model puts it, and nothing covers the raw image."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import project
from jaxgeo.data import Camera
from jaxgeo.export.contact_sheet import SheetImage, contact_sheet, thumbnail
from jaxgeo.export.detection_overlay import MarkerPoses, detection_overlay
from jaxgeo.export.image_drawing import AXES, OUTLINE, draw_axes, draw_markers, fitting, words_size

WIDTH, HEIGHT, SIZE_M = 640, 480, 0.4
CAMERA = Camera(
    intrinsics_px=np.array([400.0, 410.0, 315.0, 245.0]),
    distortion_model="radtan",
    distortion=np.array([-0.25, 0.06, 0.001, -0.002]),
    resolution_px=(WIDTH, HEIGHT),
    t_body_cam_m=np.zeros(3),
    quat_body_cam_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
)
T_M = np.array([0.5, -0.3, 1.5])
R = Rotation.from_euler("xyz", [2.6, 0.5, 0.4]).as_matrix()
SQUARE = SIZE_M / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
CORNERS = project(T_M + SQUARE @ R.T, CAMERA)[0]
GRAY = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)


def blank():
    return np.zeros((HEIGHT, WIDTH, 3), np.uint8)


def near(image, colour, at_px, reach=2):
    """Is the colour drawn within so many pixels of a point?"""
    x, y = np.round(at_px).astype(int)
    part = image[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
    return bool((np.abs(part.astype(int) - colour).max(axis=2) < 40).any())


def test_axes_end_where_the_camera_sees_half_a_side():
    image = blank()
    draw_axes(image, CAMERA, T_M, R, SIZE_M / 2, 2)
    for axis, colour in enumerate(AXES):
        ends = project(T_M + np.array([[0.95], [1.3]]) * SIZE_M / 2 * R[:, axis], CAMERA)[0]
        assert near(image, colour, ends[0])
        assert not near(image, colour, ends[1])


def test_an_axis_that_leaves_the_camera_is_left_out():
    image = blank()
    draw_axes(image, CAMERA, np.array([0.0, 0.0, 0.1]), np.eye(3) * [1, -1, -1], 0.2, 2)
    assert not near(image, AXES[2], CAMERA.intrinsics_px[2:], reach=300)


def test_outline_goes_through_the_corners():
    image = blank()
    draw_markers(image, CORNERS[None], ["7"], 12.0)
    middles = (CORNERS + np.roll(CORNERS, -1, axis=0)) / 2
    assert all(near(image, OUTLINE, at) for at in [*CORNERS, *middles])


@pytest.mark.parametrize("at", [(-200.0, -150.0), (300.0, 400.0), (0.0, 440.0)])
def test_a_name_stays_inside_the_image(at):
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    draw_markers(image, np.array([[[0.0, 40], [40, 40], [40, 0], [0, 0]]]) + at, ["apriltag_36h11:123"], 16.0)
    white = np.argwhere((image == 255).all(axis=2))
    assert len(white) > 100
    extent = np.ptp(white, axis=0)[1]
    assert extent > 0.8 * words_size("apriltag_36h11:123", 16.0)[0]


def test_panels_are_raw_mask_and_markers():
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[100:200, 100:200] = 255
    poses = MarkerPoses(CAMERA, T_M[None], R[None], np.array([SIZE_M]))
    page = detection_overlay(GRAY, CORNERS[None], ["7"], mask=mask, poses=poses, title="1.000 s, cam0")
    raw, masked, marked = (page[-HEIGHT:, k * (WIDTH + 6) : k * (WIDTH + 6) + WIDTH] for k in range(3))
    np.testing.assert_array_equal(raw, GRAY)
    np.testing.assert_array_equal(masked[:, :, 0], mask)
    assert near(marked, OUTLINE, CORNERS[0])
    assert near(marked, AXES[0], project(T_M[None] + 0.45 * SIZE_M * R[:, 0], CAMERA)[0][0])
    without = detection_overlay(GRAY, CORNERS[None], ["7"])
    assert without.shape[1] == 2 * WIDTH + 6
    assert without.shape[0] < page.shape[0]
    assert (GRAY == 90).all()


def test_small_images_are_enlarged_with_everything_in_them():
    small = np.full((HEIGHT // 4, WIDTH // 4, 3), 90, np.uint8)
    corners = (CORNERS + 0.5) / 4 - 0.5
    page = detection_overlay(small, corners[None], ["7"])
    marked = page[-360:, 480 + 6 :]
    assert marked.shape[:2] == (360, 480)
    assert all(near(marked, OUTLINE, (corner + 0.5) * 0.75 - 0.5) for corner in CORNERS)


def test_thumbnails_keep_corners_on_their_pixels():
    image = blank()
    image[200:300, 100:200] = 255
    edges = np.array([[99.5, 299.5], [199.5, 299.5], [199.5, 199.5], [99.5, 199.5]])  # between pixels
    small = thumbnail(SheetImage(image, "", edges[None], ["1"]), WIDTH // 5)
    np.testing.assert_allclose(small.corners_px[0, 3], [19.5, 39.5])
    assert small.image[40, 20].min() == 255
    assert small.image[39, 19].max() == 0


def test_a_sheet_has_its_images_in_rows_under_their_labels():
    shades = [40, 80, 120, 160, 200]
    images = [SheetImage(np.full((50, 100), shade, np.uint8), f"{shade}", np.zeros((0, 4, 2)), []) for shade in shades]
    page = contact_sheet(images, "title", columns=3, width_px=100)
    assert page.shape[1] == 3 * 108 + 8
    columns = [8 + 108 * k + 50 for k in range(3)]
    found = [[shade for shade in shades if (page[:, x] == shade).all(axis=1).sum() >= 50] for x in columns]
    assert found == [[40, 160], [80, 200], [120]]


def test_a_sheet_of_nothing_is_refused():
    with pytest.raises(ValueError, match="no images"):
        contact_sheet([], "title")


def test_words_are_cut_to_the_room_there_is():
    assert fitting("short", 500, 12.0) == "short"
    cut = fitting("a very long name of a file.png", 80, 12.0)
    assert cut.endswith("..")
    assert words_size(cut, 12.0)[0] <= 80
