"""The six tetrahedra of a cube, for what clips cells and for what cuts them by planes."""

import numpy as np

#: Corners of the six tetrahedra into which the main diagonal cuts a cube (H. Freudenthal, H. Kuhn),
#: shape (6, 4, 3): one axis after the other, in all orders; the first three are right-handed.
KUHN = np.array(
    [np.tri(4, 3, -1, dtype=np.int64)[:, np.argsort(order)] for order in
     ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0))]
)  # fmt: skip
