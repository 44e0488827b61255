"""Where the real recordings lie: `$JAXGEO_DATA`, else `shared/data` beside the repository."""

import os
from pathlib import Path

import pytest


def data_root() -> Path:
    """Folder of the real data; where it is absent the calling test skips, loudly, or fails if JAXGEO_REQUIRE_DATA=1."""
    root = Path(os.environ.get("JAXGEO_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    if not root.is_dir():
        message = f"REAL DATA MISSING: no folder {root}; set JAXGEO_DATA to the data folder"
        if os.environ.get("JAXGEO_REQUIRE_DATA") == "1":
            pytest.fail(message)
        pytest.skip(message)
    return root
