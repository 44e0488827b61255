"""LiDAR scans from files: folders, packed arrays, ROS bags.

    scans = open_scans(path, kind=None, stamps=None, rate_hz=None, start_s=None, topic=None, on_bad="raise")
    scans.n_scans       # how many there are
    scans.bad           # {index: message} of scans that could not be read; empty unless on_bad="skip"
    for scan in scans.scans(start=0):  # or: for scan in scans
        scan.stamp_s, scan.points_m, scan.time_s, scan.intensity  # see jaxgeo.data.Scan

What is wrong with a source as a whole is a `ScanError` when it is made; a scan that cannot be read is one while
reading, or with on_bad="skip" an `InputWarning` and an entry of `bad`. `write_scan` and `write_packed_scans` write.
"""

from jaxgeo.io.scans.bag import BagScans
from jaxgeo.io.scans.folder import FolderScans
from jaxgeo.io.scans.packed import PackedScans
from jaxgeo.io.scans.scan_source import ScanSource
from jaxgeo.io.scans.source import open_scans
from jaxgeo.io.scans.write import write_packed_scans, write_scan

__all__ = ["BagScans", "FolderScans", "PackedScans", "ScanSource", "open_scans", "write_packed_scans", "write_scan"]
