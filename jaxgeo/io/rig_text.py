"""A rig as the text of its file."""

from typing import Any

from jaxgeo.data import Rig
from jaxgeo.io.yaml_text import dump_yaml


def rig_yaml(rig: Rig) -> str:
    """A rig as `jaxgeo.io.read_rig` reads it."""
    cameras: dict[str, Any] = {}
    for name, camera in rig.cameras.items():
        cameras[name] = {
            "model": "pinhole",
            "intrinsics_px": camera.intrinsics_px.tolist(),
            "distortion_model": camera.distortion_model,
            "distortion": camera.distortion.tolist(),
            **({} if camera.resolution_px is None else {"resolution_px": list(camera.resolution_px)}),
            "t_body_cam_m": camera.t_body_cam_m.tolist(),
            "quat_body_cam_wxyz": camera.quat_body_cam_wxyz.tolist(),
        }
    return dump_yaml({"cameras": cameras})
