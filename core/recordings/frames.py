"""Pictures of an ordinary camera that were recorded beside the events."""

from __future__ import annotations

import h5py
import numpy as np
from numpy.typing import NDArray

from core.recordings.hdf5 import dataset_at, read_only


class FrameStream:
    """Frames by number, read one at a time."""

    def __init__(self, group: h5py.Group) -> None:
        self._images = dataset_at(group, "image")
        self.t_us = read_only(dataset_at(group, "t_us")[()].astype(np.int64))
        """Mid exposure."""
        self.exposure_us = read_only(dataset_at(group, "exposure_us")[()].astype(np.int64))

    def __len__(self) -> int:
        return len(self.t_us)

    def image(self, number: int) -> NDArray[np.uint8]:
        """(height, width) or (height, width, 3 = RGB)."""
        return read_only(self._images[number])
