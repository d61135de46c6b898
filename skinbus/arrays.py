"""Types of arrays, by what they hold."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Ints32 = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]
