"""Whether simplices overlap in space, by separating axes.

Guarantee: simplices called apart are apart, or overlap by less than 1e-9 of their longest edge;
what touches at a common corner is apart.
"""

import numpy as np
from scipy.spatial import cKDTree

from ilattice._typing import IntArray
from ilattice._validate import as_kind
from ilattice.cost import _kernels_flips as kernels
from ilattice.cost._structure import Structure

#: Overlap, in longest edges, that counts as none.
EPS = 1e-9


def overlaps(k: Structure) -> IntArray:
    """Pairs of simplices that overlap.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    ndarray of int, shape (p, 2)
        The pairs, in rising order; none if the structure is embedded.
    """
    as_kind("k", k, "CornerSharing")
    corners = k.positions[k.simplices]
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    # Few are large: pairs are looked for with the larger radius of each.
    tree = cKDTree(middle)
    small = reach <= 2.0 * np.median(reach)
    most = float(reach[small].max(initial=0.0))
    pairs = [tree.query_pairs(2.0 * most, output_type="ndarray").reshape(-1, 2)]
    for i in np.flatnonzero(~small):
        near = np.array(tree.query_ball_point(middle[i], reach[i] + reach.max()), np.int64)
        pairs.append(np.stack([np.minimum(i, near), np.maximum(i, near)], axis=1)[near != i])
    both = np.unique(np.concatenate(pairs).astype(np.int64), axis=0)
    gap = np.linalg.norm(middle[both[:, 0]] - middle[both[:, 1]], axis=1)
    both = np.ascontiguousarray(both[gap < reach[both].sum(axis=1)])
    out = np.zeros(len(both), np.bool_)
    kernels.overlaps(np.array(k.positions), np.array(k.simplices), both, EPS, out)
    return np.asarray(both[out])
