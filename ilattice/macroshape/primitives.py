"""Spline volumes made from a few numbers: boxes, tori, shells, a duck, a wing.

Guarantees: each shape is right-handed, VALID by certificate for the default arguments, and on
the domain [0, 1]³. Shapes called exact are rational; the others state their deviation.
Non-guarantees: extreme arguments may fold a shape; `SplineMap.certificate` tells.
"""

import numpy as np

from ilattice._geometry import CORNERS
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_array, as_positive, as_triple
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.macroshape.maps import SplineMap
from ilattice.macroshape.sweeps import clamped, revolve

__all__ = [
    "affine",
    "box",
    "cylinder_shell",
    "duck",
    "hexahedron",
    "identity",
    "tapered",
    "torus",
    "wing",
]

#: Spans around an axis.
MAX_SPANS = 10_000
#: Knots of a straight line.
_LINE = (0.0, 0.0, 1.0, 1.0)
#: VTK order of the corners of a hexahedron, as indices along u, v, w.
_HEXAHEDRON = ([0, 1, 1, 0, 0, 1, 1, 0], [0, 0, 1, 1, 0, 0, 1, 1], [0, 0, 0, 0, 1, 1, 1, 1])

#: Sections of the duck, tail to bill: x, z, tilt in degrees, half width, half height.
_DUCK = np.array(
    [
        [-2.30, 0.95, -28, 0.22, 0.10],
        [-1.85, 0.70, -30, 0.55, 0.26],
        [-1.20, 0.30, -22, 0.95, 0.58],
        [-0.45, 0.05, -6, 1.10, 0.78],
        [0.35, 0.05, 10, 1.05, 0.80],
        [1.05, 0.45, 42, 0.78, 0.62],
        [1.35, 1.15, 72, 0.46, 0.42],
        [1.50, 1.80, 58, 0.56, 0.52],
        [2.00, 2.15, 10, 0.42, 0.34],
        [2.60, 2.12, -4, 0.30, 0.10],
    ]
)

#: Cubic Bézier fit of NACA 0012 with a blunted nose and tail: chord and half thickness.
_AIRFOIL_X = (0.0, 0.02, 0.27752, 1.0)
_AIRFOIL_Y = (0.004, 0.056289, 0.098896, 0.001344)


def _trilinear(corners: FloatArray) -> SplineMap:
    return SplineMap(BSpline([_LINE] * 3, corners, 1))


def _between(name: str, value: float, low: float, high: float) -> float:
    a = as_array(name, value)
    if a.size != 1 or not low <= a.ravel()[0] <= high:
        raise InputError(f"{name} must be from {low:g} to {high:g}, got {value!r}")
    return float(a.ravel()[0])


def identity() -> SplineMap:
    """The unit cube, mapped to itself.

    Returns
    -------
    SplineMap
        Trilinear, 2×2×2.
    """
    return affine(np.eye(3))


def affine(matrix: ArrayLike, offset: ArrayLike = 0.0) -> SplineMap:
    """Affine image of the unit cube.

    Parameters
    ----------
    matrix : array_like, shape (3, 3)
        ``x = matrix @ u + offset``. A matrix of negative determinant gives a left-handed map.
    offset : array_like, shape (3,), or float
        Image of the origin.

    Returns
    -------
    SplineMap
        Trilinear, 2×2×2.

    Raises
    ------
    InputError
        If the matrix is not 3×3, or singular.
    """
    a = as_array("matrix", matrix, ndim=2)
    if a.shape != (3, 3):
        raise InputError(f"matrix must be of shape (3, 3), got {a.shape}")
    if np.linalg.cond(a) > 1e14:
        raise InputError(f"matrix must be regular, its singular values are {np.linalg.svd(a)[1]}")
    u = CORNERS.reshape(2, 2, 2, 3).astype(np.float64)
    return _trilinear(u @ a.T + as_triple("offset", offset))


def box(
    lengths: ArrayLike = 1.0, *, lo: ArrayLike | None = None, hi: ArrayLike | None = None
) -> SplineMap:
    """Box with its edges along the axes.

    Parameters
    ----------
    lengths : array_like, shape (3,), or float
        Edge lengths, from the corner `lo`.
    lo : array_like, shape (3,), optional
        Lower corner, by default the origin.
    hi : array_like, shape (3,), optional
        Upper corner; instead of `lengths`.

    Returns
    -------
    SplineMap
        Trilinear, 2×2×2.

    Raises
    ------
    InputError
        If an edge would not be of positive length.
    """
    corner = np.zeros(3) if lo is None else as_triple("lo", lo)
    if hi is None:
        size = as_triple("lengths", lengths, positive=True)
    else:
        size = as_triple("hi", hi) - corner
        if (size <= 0).any():
            raise InputError(f"hi must be above lo = {corner.tolist()}, got {hi!r}")
    return affine(np.diag(size), corner)


def hexahedron(corners: ArrayLike) -> SplineMap:
    """Trilinear volume with eight corners.

    Parameters
    ----------
    corners : array_like, shape (8, 3) or (2, 2, 2, 3)
        Eight points in the order of finite elements and VTK: the face w = 0 counterclockwise
        seen from above, (0,0), (1,0), (1,1), (0,1), then the face w = 1 alike; or an array
        indexed along u, v, w.

    Returns
    -------
    SplineMap
        2×2×2.

    Raises
    ------
    InputError
        If the shape is another.
    """
    c = as_array("corners", corners)
    if c.shape == (8, 3):
        grid = np.empty((2, 2, 2, 3))
        grid[_HEXAHEDRON] = c
        c = grid
    if c.shape != (2, 2, 2, 3):
        raise InputError(f"corners must be of shape (8, 3) or (2, 2, 2, 3), got {c.shape}")
    return _trilinear(c)


def tapered(base: float = 1.0, top: float = 0.5, height: float = 1.0) -> SplineMap:
    """Square frustum whose levels w = const are flat.

    The surface w = c is the plane ``z = c * height``, so that its distance is known exactly:
    Figure 13 of Hong, Antolin, Elber, Kim (Variable offsets and processing of implicit forms).

    Parameters
    ----------
    base, top : float
        Side of the square at z = 0 and at z = height, both centred on the z-axis.
    height : float
        Height.

    Returns
    -------
    SplineMap
        Trilinear, 2×2×2; w is the height.
    """
    sides = np.array([as_positive("base", base), as_positive("top", top)])
    h = as_positive("height", height)
    u = CORNERS.reshape(2, 2, 2, 3).astype(np.float64)
    across = (u[..., :2] - 0.5) * sides[None, None, :, None]
    return _trilinear(np.concatenate([across, h * u[..., 2:]], axis=-1))


def _section(r0: float, r1: float, z0: float, z1: float) -> BSpline:
    """Rectangle in the half-plane y = 0, x > 0, with parameters height and radius."""
    c = np.array([[(r, 0.0, z) for r in (r0, r1)] for z in (z0, z1)])
    return BSpline([_LINE] * 2, c, 1)


def cylinder_shell(
    r0: float = 1.0, r1: float = 2.0, height: float = 1.0, angle: float = 2 * np.pi
) -> SplineMap:
    """Exact cylindrical shell around the z-axis.

    Parameters
    ----------
    r0, r1 : float
        Inner and outer radius.
    height : float
        From z = 0 upwards.
    angle : float
        In radians, up to a full turn, counterclockwise from the x-axis.

    Returns
    -------
    SplineMap
        Rational, degrees (2, 1, 1); u is the angle, v the height, w the radius. A full turn
        is closed along u.

    Raises
    ------
    InputError
        If a length is not positive, or the radii are not in order.
    """
    inner, outer = as_positive("r0", r0), as_positive("r1", r1)
    if outer <= inner:
        raise InputError(f"r1 must be above r0 = {r0}, got {r1}")
    return revolve(_section(inner, outer, 0.0, as_positive("height", height)), angle=angle)


def torus(
    major: float = 4.0, width: float = 2.0, *, form: str = "periodic", spans: int = 10
) -> SplineMap:
    """Torus with a square cross-section around the z-axis.

    Parameters
    ----------
    major : float
        Radius of the centre line.
    width : float
        Side of the square, which lies in the planes through the z-axis.
    form : {"periodic", "arcs", "exact"}
        "periodic": uniform periodic cubic, C² everywhere, radius too small by up to 4.5e-4 of
        itself for 10 spans, decreasing with their fourth power. "arcs": four cubic Bézier
        arcs, C¹, radius too large by up to 2.73e-4. "exact": rational quadratic.
    spans : int
        Spans of the periodic form, at least 4.

    Returns
    -------
    SplineMap
        Degrees (3, 1, 1) with 13×2×2 coefficients in the first two forms, (2, 1, 1) with
        9×2×2 in the third; u is the angle, v the height, w the radius. Closed along u.

    Raises
    ------
    InputError
        If a length is not positive, the square reaches the axis, or the form is unknown.
    """
    r, half = as_positive("major", major), 0.5 * as_positive("width", width)
    if half >= r:
        raise InputError(f"width must be below 2 * major = {2 * r}, got {width}")
    if not isinstance(spans, int | np.integer) or not 4 <= spans <= MAX_SPANS:
        raise InputError(f"spans must be a whole number from 4 to {MAX_SPANS}, got {spans!r:.80}")
    if isinstance(form, str) and form == "exact":
        return revolve(_section(r - half, r + half, -half, half))
    rings = {"periodic": _periodic_ring, "arcs": _four_arcs}
    if not isinstance(form, str) or form not in rings:
        raise InputError(f"form must be 'periodic', 'arcs' or 'exact', got {form!r}")
    ring, t = rings[form](int(spans))
    c = np.zeros((len(ring), 2, 2, 3))
    c[..., :2] = ring[:, None, None] * np.array([r - half, r + half])[:, None]
    c[..., 2] = np.array([-half, half])[:, None]
    return SplineMap(
        BSpline([t, _LINE, _LINE], c, (3, 1, 1), periodic=(form == "periodic", False, False))
    )


def _periodic_ring(spans: int) -> tuple[FloatArray, FloatArray]:
    """Control polygon and knots of a uniform periodic cubic that meets the circle at knots."""
    turn = 2 * np.pi / spans
    angle = turn * (np.arange(spans) - 1)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (6 / (4 + 2 * np.cos(turn)))
    return np.concatenate([points, points[:3]]), np.arange(-3, spans + 4) / spans


def _four_arcs(_: int) -> tuple[FloatArray, FloatArray]:
    """Control polygon and knots of the four cubic Bézier arcs that touch at their middles."""
    k = 4 * (np.sqrt(2) - 1) / 3
    quarter = np.array([[1, 0], [1, k], [k, 1]])
    turns = [np.array([[1, 0], [0, 1]]), np.array([[0, 1], [-1, 0]])]
    turns += [-turns[0], -turns[1]]
    points = np.concatenate([*(quarter @ t for t in turns), [[1.0, 0.0]]])
    return points, np.repeat(np.linspace(0, 1, 5), [4, 3, 3, 3, 4])


def duck(scale: float = 1.0, *, squircle: float = 0.8) -> SplineMap:
    """Duck with round sections, bill up and tail raised.

    Parameters
    ----------
    scale : float
        Size; at 1 the duck is 5 long and 3 high.
    squircle : float
        Roundness of the section control nets, from 0 (squares) to 1 (discs).

    Returns
    -------
    SplineMap
        Degrees (2, 2, 2), 10×6×4 coefficients: u runs along the body from tail to bill, v
        across it, w upwards, so that ``repeat=(18, 5, 4)`` puts 18 tiles along the body.

    Raises
    ------
    InputError
        If the scale is not positive, or the roundness is not from 0 to 1.

    Notes
    -----
    Size and degrees are those of the duck of Hong, Antolin, Elber, Kim (Variable offsets and
    processing of implicit forms), who list 6×4×10 coefficients; the shape is our own.
    """
    size = as_positive("scale", scale)
    kappa = _between("squircle", squircle, 0, 1)
    knots = [clamped(n, 2) for n in (10, 6, 4)]
    g = [np.convolve(t[1:-1], [0.5, 0.5], "valid") for t in knots]
    V, W = 2 * g[1][:, None] - 1, 2 * g[2] - 1
    across, up = V * np.sqrt(1 - kappa * W**2 / 2), W * np.sqrt(1 - kappa * V**2 / 2)
    x, z, tilt, a, h = _DUCK.T[:, :, None, None]
    tilt = np.deg2rad(tilt)
    c = np.stack([x - h * up * np.sin(tilt), a * across, z + h * up * np.cos(tilt)], axis=-1)
    return SplineMap(BSpline(knots, size * c, 2))


def wing(
    span: float = 4.0,
    chord: float = 1.0,
    *,
    tip: float = 0.35,
    thickness: float = 0.12,
    thinning: float = 0.25,
    sweep: float = np.deg2rad(25.0),
    dihedral: float = np.deg2rad(5.0),
    twist: float = np.deg2rad(-4.0),
) -> SplineMap:
    """Swept, tapered and twisted wing with a NACA-like section.

    The section is a cubic Bézier fit of the four-digit NACA thickness, within 0.4 % of the
    chord; nose and tail are cut to a small height, so that nothing is singular.

    Parameters
    ----------
    span, chord : float
        Length of the wing, and chord at its root.
    tip : float
        Chord at the tip as a part of that at the root.
    thickness : float
        Greatest thickness at the root as a part of the chord.
    thinning : float
        By how much the relative thickness is less at the tip, as a part of that at the root.
    sweep, dihedral, twist : float
        Angles in radians: quarter-chord line backwards, span upwards, nose up at the tip.

    Returns
    -------
    SplineMap
        Degrees (3, 1, 2), 4×2×10 coefficients; u runs along the chord from nose to tail, v
        from the lower to the upper skin, w along the span towards -y.

    Raises
    ------
    InputError
        If a length or a ratio is not positive, `thinning` is not from 0 to 0.99, or an angle
        is not from -1.5 to 1.5 (the twist: not from -π to π).
    """
    length, c0 = as_positive("span", span), as_positive("chord", chord)
    tip, thick = as_positive("tip", tip), as_positive("thickness", thickness)
    thinning = _between("thinning", thinning, 0, 0.99)
    sweep, dihedral = _between("sweep", sweep, -1.5, 1.5), _between("dihedral", dihedral, -1.5, 1.5)
    twist = _between("twist", twist, -np.pi, np.pi)
    knots = clamped(10, 2)
    e = np.convolve(knots[1:-1], [0.5, 0.5], "valid")
    size = c0 * (1 + (tip - 1) * e)
    skin = np.array([-1.0, 1.0])[:, None] * (1 - thinning * e) * (thick / 0.12)
    x = np.broadcast_to((np.array(_AIRFOIL_X) - 0.25)[:, None, None] * size, (4, 2, 10))
    z = np.array(_AIRFOIL_Y)[:, None, None] * skin * size
    cos, sin = np.cos(twist * e), np.sin(twist * e)
    c = np.empty((4, 2, 10, 3))
    c[..., 0] = 0.25 * c0 + cos * x + sin * z + length * e * np.tan(sweep)
    c[..., 1] = -length * e
    c[..., 2] = -sin * x + cos * z + length * e * np.tan(dihedral)
    return SplineMap(BSpline([(0.0,) * 4 + (1.0,) * 4, _LINE, knots], c, (3, 1, 2)))
