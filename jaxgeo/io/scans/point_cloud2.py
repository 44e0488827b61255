"""The fields of a sensor_msgs/PointCloud2."""

from typing import Any

import numpy as np

from jaxgeo.io.scans.scan_source import UnreadableScanError

# The constants of sensor_msgs/PointField
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def columns_of_message(message: Any, source: str) -> dict[str, np.ndarray]:
    """The fields with one number a point, by name, in the message's own types; rows and points may be padded.

    Fields of several numbers, and of types this release of ROS does not know, are left alone. Of fields with one name
    the first counts.

    Raises:
        UnreadableScanError: a field lies outside its point, or the data are too few.
    """
    height, width = int(message.height), int(message.width)
    point_step, row_step = int(message.point_step), int(message.row_step)
    order = ">" if message.is_bigendian else "<"
    row = width * point_step
    # Some drivers leave the step of the only row 0
    row_step = row if height == 1 else row_step
    data = np.ascontiguousarray(message.data, np.uint8)
    if height and width and (row_step < row or len(data) < row_step * (height - 1) + row):
        raise UnreadableScanError(
            f"{source}: {len(data)} bytes in rows of {row_step}, expected {height} rows of at least {row} bytes "
            f"({width} points of {point_step}). The message is damaged, or its driver fills it wrongly."
        )
    columns: dict[str, np.ndarray] = {}
    for field in message.fields:
        kind = DATATYPES.get(int(field.datatype))
        if kind is None or field.count > 1 or field.name in columns:  # a count of 0 is an old way to say 1
            continue
        dtype = np.dtype(order + kind)
        if field.offset + dtype.itemsize > point_step:
            raise UnreadableScanError(
                f"{source}: field {field.name!r} lies at bytes {field.offset} to {field.offset + dtype.itemsize} of a "
                f"point of {point_step}. The message is damaged, or its driver fills it wrongly."
            )
        if not height * width:
            columns[field.name] = np.empty(0, dtype)
            continue
        view = np.ndarray((height, width), dtype, data, field.offset, (row_step, point_step))
        columns[field.name] = view.reshape(-1)
    return columns
