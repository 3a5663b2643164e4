"""Exact algebra of separable trigonometric terms, and the notation the catalogue is written in.

A polynomial is a dictionary from three factor codes (one per axis, see `_kernels`) to a
coefficient. Products are expanded by the product formulas, so that a polynomial in normal form
holds at most one factor per axis in each term.

The notation is what the literature prints, period 1, ``X = 2 pi x`` and so on::

    2 sum[cosX cosY] - sum[cos2X]          sum[...] adds the two cyclic shifts X -> Y -> Z -> X
    cos(3X+Y) cosZ - sin(3X-Y) sinZ        linear combinations in parentheses
    -sqrt(3) sinZ (cos(X-Y) - cosX)        numbers, square roots, products by juxtaposition or *

Guarantee: whatever is not of this form is refused with its position; nothing is evaluated by
Python.
"""

import re
from math import sqrt

from ilattice.errors import InputError

Codes = tuple[int, int, int]
Terms = dict[Codes, float]

ONE: Terms = {(0, 0, 0): 1.0}
#: What notation may have: multiples of an angle, and brackets.
MAX_HARMONIC, MAX_BRACKETS = 32, 200


def _code(kind: str, harmonic: int) -> tuple[float, int]:
    """Sign and code of cos or sin of a possibly negative harmonic; sign 0 for sin 0."""
    if kind == "cos":
        return 1.0, max(2 * abs(harmonic) - 1, 0)
    if harmonic == 0:
        return 0.0, 0
    return (1.0 if harmonic > 0 else -1.0), 2 * abs(harmonic)


def _split(code: int) -> tuple[str, int]:
    """Kind and harmonic of a code."""
    return ("sin" if code and code % 2 == 0 else "cos"), (code + 1) // 2


def _factor_product(a: int, b: int) -> list[tuple[float, int]]:
    """Product of two factors of the same axis as a sum of (coefficient, code)."""
    if a == 0 or b == 0:
        return [(1.0, a + b)]
    (ka, ha), (kb, hb) = _split(a), _split(b)
    if ka == kb:
        plus = 0.5 if ka == "cos" else -0.5
        pairs = [(0.5, _code("cos", ha - hb)), (plus, _code("cos", ha + hb))]
    else:
        s, c = (ha, hb) if ka == "sin" else (hb, ha)
        pairs = [(0.5, _code("sin", s + c)), (0.5, _code("sin", s - c))]
    return [(w * sign, code) for w, (sign, code) in pairs if sign]


def add(p: Terms, q: Terms, scale: float = 1.0) -> Terms:
    """``p + scale * q``."""
    out = dict(p)
    for key, value in q.items():
        out[key] = out.get(key, 0.0) + scale * value
    return out


def multiply(p: Terms, q: Terms) -> Terms:
    """``p * q``, expanded."""
    out: Terms = {}
    for a, u in p.items():
        for b, v in q.items():
            axes = [_factor_product(i, j) for i, j in zip(a, b, strict=True)]
            for wx, x in axes[0]:
                for wy, y in axes[1]:
                    for wz, z in axes[2]:
                        out[x, y, z] = out.get((x, y, z), 0.0) + u * v * wx * wy * wz
    return out


def wave(kind: str, harmonics: tuple[int, int, int]) -> Terms:
    """``cos`` or ``sin`` of ``i X + j Y + k Z``, expanded by angle addition."""
    c: Terms = ONE
    s: Terms = {}
    for axis, h in enumerate(harmonics):
        (_, cos_code), (sign, sin_code) = _code("cos", h), _code("sin", h)
        cos_h = {_on_axis(axis, cos_code): 1.0}
        sin_h = {_on_axis(axis, sin_code): sign} if sign else {}
        c, s = (
            add(multiply(c, cos_h), multiply(s, sin_h), -1.0),
            add(multiply(s, cos_h), multiply(c, sin_h)),
        )
    return c if kind == "cos" else s


def _on_axis(axis: int, code: int) -> Codes:
    x, y, z = (code if a == axis else 0 for a in range(3))
    return x, y, z


def cyclic_sum(p: Terms) -> Terms:
    """``p`` and its two cyclic shifts X -> Y -> Z -> X."""
    once = {(c, a, b): v for (a, b, c), v in p.items()}
    twice = {(b, c, a): v for (a, b, c), v in p.items()}
    return add(add(p, once), twice)


def pruned(p: Terms) -> Terms:
    """``p`` in a fixed order, without terms below the rounding of the largest."""
    top = max((abs(v) for v in p.values()), default=0.0)
    kept = {k: v for k, v in p.items() if abs(v) > 1e-15 * top}
    return dict(sorted(kept.items(), key=lambda item: item[0][::-1]))


def text(p: Terms) -> str:
    """``p`` in the notation of this module; `parse` gives the same terms back."""
    parts = []
    for codes, value in p.items():
        factors = [_factor_text(c, axis) for c, axis in zip(codes, "XYZ", strict=True) if c]
        number = [] if factors and abs(value) == 1.0 else [repr(abs(value))]
        parts.append(("- " if value < 0 else "+ ") + " ".join(number + factors))
    return " ".join(parts).removeprefix("+ ") if parts else "0"


def _factor_text(code: int, axis: str) -> str:
    kind, harmonic = _split(code)
    return f"{kind}{harmonic if harmonic > 1 else ''}{axis}"


_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)|sqrt\((?P<root>\d+\.?\d*)\)"
    r"|(?P<kind>cos|sin)(?:(?P<harmonic>\d*)(?P<axis>[XYZ])|\((?P<angle>[^()]*)\))"
    r"|(?P<open>sum\[|\()|(?P<close>[\])])|(?P<sign>[+-])|(?P<times>\*))"
)
_ANGLE = re.compile(r"\s*([+-]?)\s*(\d*)\s*\*?\s*([XYZ])")


def parse(text: str) -> Terms:
    """Terms of a polynomial written in the notation of this module.

    Raises
    ------
    InputError
        Where the text leaves the notation: with the position and the rest.
    """
    if text.count("(") + text.count("[") > MAX_BRACKETS:
        raise InputError(f"trigonometric notation: more than {MAX_BRACKETS} brackets")
    terms, at = _parse_sum(text, 0)
    if at != len(text.rstrip()):
        raise _fault(text, at, "an operator or the end")
    return pruned(terms)


def _fault(text: str, at: int, expected: str) -> InputError:
    return InputError(
        f"trigonometric notation: expected {expected} at position {at}, before {text[at:]!r:.40}; "
        "write it like '2 sum[cosX cosY] - cos(3X+Y) sin2Z + 0.3'"
    )


def _parse_sum(text: str, at: int) -> tuple[Terms, int]:
    total: Terms = {}
    first = True
    while True:
        m = _TOKEN.match(text, at)
        sign = 1.0
        if m and m["sign"]:
            sign, at = (-1.0 if m["sign"] == "-" else 1.0), m.end()
        elif not first:
            return total, at
        product, at = _parse_product(text, at)
        total = add(total, product, sign)
        first = False


def _parse_product(text: str, at: int) -> tuple[Terms, int]:
    product: Terms | None = None
    pending = True
    while True:
        m = _TOKEN.match(text, at)
        if m and m["times"] and not pending:
            at, pending = m.end(), True
            continue
        if m is None or m["close"] or m["sign"] or m["times"]:
            if product is None or pending:
                raise _fault(text, at, "a number, cos, sin, sum[ or (")
            return product, at
        factor, at = _parse_factor(text, m)
        product = factor if product is None else multiply(product, factor)
        pending = False


def _parse_factor(text: str, m: re.Match[str]) -> tuple[Terms, int]:
    if m["number"]:
        return {(0, 0, 0): float(m["number"])}, m.end()
    if m["root"]:
        return {(0, 0, 0): sqrt(float(m["root"]))}, m.end()
    if m["open"]:
        inner, at = _parse_sum(text, m.end())
        close = "]" if m["open"] == "sum[" else ")"
        end = _TOKEN.match(text, at)
        if end is None or end["close"] != close:
            raise _fault(text, at, repr(close))
        return (cyclic_sum(inner) if close == "]" else inner), end.end()
    angle = f"{m['harmonic']}{m['axis']}" if m["axis"] else m["angle"]
    return wave(m["kind"], _parse_angle(text, m, angle)), m.end()


def _parse_angle(text: str, m: re.Match[str], angle: str) -> tuple[int, int, int]:
    harmonics = [0, 0, 0]
    at = 0
    while at < len(angle.rstrip()):
        part = _ANGLE.match(angle, at)
        if part is None or (at > 0 and not part[1]):
            raise _fault(text, m.start(), "an angle like 3X-Y")
        h = int(part[2]) if part[2] else 1
        harmonics["XYZ".index(part[3])] += -h if part[1] == "-" else h
        at = part.end()
    if at == 0 or max(abs(h) for h in harmonics) > MAX_HARMONIC:
        raise _fault(text, m.start(), f"an angle with harmonics up to {MAX_HARMONIC}")
    i, j, k = harmonics
    return i, j, k
