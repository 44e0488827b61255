"""Files at which a reader once broke its contract, by target and by what was wrong; made small by hand."""

import io
import zipfile

import numpy as np

from benchmarks.fuzz.binary_targets import npy

_STILL = b"0 0 0 0 0 0 0 1\n"
_UPPER = b"1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
_EDGE = b"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 " + _UPPER + b"\n"
_VERTICES = b"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n"
_QUAD = b",1,1,9,1,9,9,1,9,"
_CAMERA = b"cameras:\n  a:\n    intrinsics_px: [600, 600, 320, 240]\n    t_body_cam_m: [0, 0, 0]\n"
_UNDISTORTED = _CAMERA + b"    distortion_model: none\n"
_SIGNALLING = np.array([0x7FA00000], "<u4").tobytes()  # a NaN of which NumPy warns when it becomes a float64


def _las_head(n_records: int) -> bytes:
    """The head of an empty LAS 1.2 file that announces records behind it."""
    head = bytearray(227)
    head[:4], head[24:26] = b"LASF", b"\1\2"
    head[94:96], head[96:100], head[100:104] = (
        n.to_bytes(s, "little") for n, s in ((227, 2), (227, 4), (n_records, 4))
    )
    head[105:107] = (20).to_bytes(2, "little")
    return bytes(head)


def _zeros_packed() -> bytes:
    """A hundred thousand bytes that unpack to a hundred million."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xyz.npy", b"\0" * 100_000_000)
    return file.getvalue()


def _pose(value: float) -> np.ndarray:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 0] = value
    return poses


ONCE_CRASHED: dict[str, dict[str, bytes]] = {
    "tum": {"a quaternion whose norm is beyond float64": _STILL + b"1 0 0 0 1e308 1e308 0 1\n"},
    "kitti": {
        "a rotation whose square is beyond float64": b"1 0 0 0 0 1 0 0 0 0 1 0\n1e308 1 0 0 0 1e308 1 0 0 0 1 0\n"
    },
    "npy-poses": {
        "a head whose bracket is not closed": npy(_pose(1.0)).replace(b"(2, 4, 4)", b"(2, 4, 4 "),
        "a rotation whose square is beyond float64": npy(_pose(1e308)),
    },
    "g2o-graph": {
        "an id of two signs": _VERTICES + b"FIX --5\n" + _EDGE,
        "an id of 5000 digits": _VERTICES + b"VERTEX_SE3:QUAT " + b"9" * 5000 + b" 0 0 0 0 0 0 1\n" + _EDGE,
    },
    "g2o-poses": {
        "a tag that fills the screen": b"VERTEX" + b"9" * 5000 + b" 1 2 3\n",
        "a landmark's id of 5000 digits": _VERTICES + b"EDGE_SE3 0 " + b"9" * 5000 + b"\n",
    },
    "survey": {"a header that fills the screen": b"name,N,E,h,sigma" + b"9" * 5000 + b"\nA,1,2,3,4\n"},
    "control-points": {"a mean beyond float64": b"stamp_s,name,E,N,h\n1,A,1e308,2,3\n2,A,1e308,2,3\n"},
    "corners": {
        "a variance beyond float64": b"stamp_s,camera,u0,v0,u1,v1,u2,v2,u3,v3,sigma_px\n1,a" + _QUAD + b"1e200\n"
    },
    "poses": {
        "a variance beyond float64": b"stamp_s,x,y,z,sigma_m\n1,1,2,3,1e200\n",
        "a quaternion whose norm is beyond float64": b"stamp_s,x,y,z,qw,qx,qy,qz\n1,1,2,3,1e308,1e308,0,0\n",
    },
    "image-stamps": {
        "a stamp beyond float64": b"stamp_ns,file\n1e400,a.png\n",
        "a stamp beyond decimals": b"stamp_s,file\n1e99999999,a.png\n",
    },
    "scan-stamps": {
        "a stamp beyond decimals": b"1\n2\n1e99999999\n",
        "a message that fills the screen": b"1\n2\n" + b"9" * 20 + b"." + b"9" * 5000 + b"\n",
    },
    "associations": {"a name too long for a file": b"1 rgb/" + b"a" * 400 + b".png 1 depth/a.png\n"},
    "labels": {
        "bytes that are no UTF-8": b"a.png,1,1,12,1.5,6,9\n\xe9.png,1,1,2,2,3,1\n",
        "a corner beyond any image": b"a.png,1,1,1e300,1.5,6,9\n",
    },
    "corrected": {
        "a system that is none": b"# crs: EPSG:x (y), origin E=1 N=2 h=3 m\n" + _STILL + b"1 0 0 0 0 0 0 1\n",
        "an origin off the earth": b"# crs: EPSG:2169 (y), origin E=1e300 N=2 h=3 m\n" + _STILL + b"1 0 0 0 0 0 0 1\n",
    },
    "areas": {
        "a polygon without an outline": b'{"type": "Polygon", "coordinates": []}',
        "half a character": b'{"type": "\\ud800"}',
    },
    "euroc": {"a stamp that is next to nothing": b"1401e-999363658084355564" + b",0" * 3 + b",1" + b",0" * 3 + b"\n"},
    "noise": {
        "a component that fills the screen": b'{"trajectories": {"a": {"learned": {"components": ["'
        + b"9" * 5000
        + b'"]}}}}'
    },
    "override": {
        "bytes that are no text": b"\xff",
        "a key that is no text": b"sightings.columns.x\xff=6",
    },
    "sessions": {"a name too long for a file": b"a" * 400 + b".yaml\n"},
    "rig": {
        "a turn beyond float64": _UNDISTORTED + b"    rotvec_body_cam_rad: [1e308, 1e308, 0]\n",
        "a matrix whose square is beyond float64": _UNDISTORTED
        + b"    R_body_cam: [[1e308, 1e308, 0], [0, 1, 0], [0, 0, 1]]\n",
        "a list in the place of a name": _CAMERA + b"    distortion_model: [none]\n",
    },
    "cloud-ply": {
        "an element that ends before it was announced to": b"ply\nformat ascii 1.0\nelement face 300\nproperty int i\n"
        b"element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1\n2\n",
        "an infinite whole number": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        b"property float z\nproperty uchar red\nend_header\n1 2 3 inf\n",
    },
    "cloud-las": {"four thousand million records announced, hours and all memory": _las_head(0xFFFFFFFF)},
    "scan-pcd": {
        "a count of 5000 digits": b"FIELDS x\nSIZE 4\nTYPE F\nCOUNT 1\nPOINTS " + b"9" * 5000 + b"\nDATA ascii\n1\n"
    },
    "scan-kitti": {"a signalling NaN": (b"\0\0\x80?" * 4) + _SIGNALLING * 4},
    "packed": {"an archive that unpacks to a thousand times its size": _zeros_packed()},
    "packed-xyz": {"a member that is no array": b"hello"},
    "rtabmap-scan-0": {"a signalling NaN": _SIGNALLING * 5 + np.array([1, 1, 5 + (4 << 3)], "<i4").tobytes()},
    "rtabmap-old-camera": {"a signalling NaN": _SIGNALLING * 18},
    "rtabmap-camera": {
        "a stereo camera cut off in R": np.array([0, 21, 1, 1, 9, 3, 0, 0, 0, 0], "<i4").tobytes() + b"\0" * 12,
    },
}
