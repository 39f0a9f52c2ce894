"""Maps as masked arrays: a cell without a value is masked."""

from __future__ import annotations

from typing import Any

from nav_msgs.msg import MapMetaData, OccupancyGrid

from taskrpc.ros.optional import needed

from .conversions import converts_from_numpy, converts_to_numpy

np = needed("numpy", "ros2_numpy")


@converts_to_numpy(OccupancyGrid)
def occupancygrid_to_numpy(msg: OccupancyGrid) -> Any:
    """The cells as a masked array of int8 with rows and columns."""
    cells = np.array(msg.data, dtype=np.int8).reshape(msg.info.height, msg.info.width)
    return np.ma.array(cells, mask=cells == -1, fill_value=-1)


@converts_from_numpy(OccupancyGrid)
def numpy_to_occupancy_grid(arr: Any, info: Any = None) -> OccupancyGrid:
    """A map of an array of int8 with rows and columns; masked cells become -1."""
    if arr.ndim != 2:
        raise TypeError("Array must be 2D")
    if arr.dtype != np.int8:
        raise TypeError("Array must be of int8s")
    grid = OccupancyGrid(info=MapMetaData() if info is None else info)
    cells = arr.filled(-1) if isinstance(arr, np.ma.MaskedArray) else arr
    grid.data = cells.ravel().tolist()
    grid.info.height, grid.info.width = (int(each) for each in arr.shape)
    return grid
