"""Grey images as the kernels take them: for every other kind of array they would be compiled anew."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


def as_plain(image: Grey) -> Grey:
    """View of an image (H, W), or a copy, in C order that nobody may write to, as those of messages are."""
    view = np.require(image, requirements="C").view()
    view.flags.writeable = False
    return view
