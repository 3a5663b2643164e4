"""The catalogue of triply periodic surfaces: rows of data, nothing else.

Every equation holds on the unit cell [0, 1]³ with ``X = 2 pi x`` and so on, in the notation of
`TrigField.parse`; the solid is {f <= level}. Names, signs and levels of the first 27 rows are those
of Cesogen (paper of the 27 TPMS, Table 1); each was compared with independent public lists.

Guarantee, held by tests: symmetry, range, Euler number, volume fraction and flags of every row are
those of its equation. Not guaranteed: that a nodal surface has the topology of the minimal surface
of the same name (``lidinoid``, ``c_d`` and ``y`` have not), or that level sets are offsets.
"""

from dataclasses import dataclass
from typing import NamedTuple

from ilattice._shown import Shown

CESOGEN = "Cesogen (paper of the 27 TPMS), Table 1"
SCAFFOLDER = "Scaffolder, list of implicit functions"
MICROGEN = "microgen, surface functions"


class Symmetry(NamedTuple):
    """Symmetry of a field under the operations of the cube and translations of the cell.

    Attributes
    ----------
    order : int
        Point operations that, with a suitable translation, leave f as it is.
    order_with_sign : int
        The same with operations that turn f into -f counted too.
    centring : int
        Translations that leave f as it is: 1 primitive, 2 body-centred, 4 face-centred; 8 or 16
        for the sampled translations of prismatic fields.
    balanced : bool
        Some operation turns f into -f: both sides are congruent.
    """

    order: int
    order_with_sign: int
    centring: int
    balanced: bool


@dataclass(frozen=True, kw_only=True)
class Row(Shown):
    """One surface of the catalogue.

    Attributes
    ----------
    name, aliases
        Identifier and what else it is called.
    equation
        The field, in the notation of `TrigField.parse`.
    range
        Least and greatest value of the equation, to six digits.
    symmetry
        See `Symmetry`.
    euler
        Euler number of the surface per unit cell at the default level; None where it is singular.
    volume_fraction, area
        Share of the cell where f <= default level, and area of that level set.
    level
        Default level.
    singular_at_zero
        The gradient vanishes somewhere on level 0.
    hexagonal
        The axes x and y are those of a hexagonal cell (120 degrees).
    disconnected
        At the default level the solid or its complement falls into several pieces.
    cyclic
        f(x, y, z) = f(y, z, x).
    prismatic
        f does not depend on z.
    note, source
        What to know, and where the equation is from.
    """

    name: str
    aliases: tuple[str, ...]
    equation: str
    range: tuple[float, float]
    symmetry: Symmetry
    euler: int | None
    volume_fraction: float
    area: float
    level: float = 0.0
    singular_at_zero: bool = False
    hexagonal: bool = False
    disconnected: bool = False
    cyclic: bool = True
    prismatic: bool = False
    note: str = ""
    source: str = CESOGEN


ROWS: tuple[Row, ...] = (
    Row(
        name="gyroid",
        aliases=("G", "Y**", "schoen_gyroid"),
        equation="sum[cosX sinY]",
        range=(-1.5, 1.5),
        symmetry=Symmetry(24, 48, 2, True),
        euler=-8,
        volume_fraction=0.5,
        area=3.092,
        note="Mirror image of sinX cosY + ..., which many other programs use.",
    ),
    Row(
        name="diamond",
        aliases=("D", "d-surface", "schwarz_d"),
        equation="sinX sinY sinZ + sum[cosX sinY cosZ]",
        range=(-1.414214, 1.414214),
        symmetry=Symmetry(48, 48, 4, True),
        euler=-16,
        volume_fraction=0.5,
        area=3.838,
    ),
    Row(
        name="primitive",
        aliases=("P", "p-surface", "schwarz_p"),
        equation="sum[cosX]",
        range=(-3.0, 3.0),
        symmetry=Symmetry(48, 48, 1, True),
        euler=-4,
        volume_fraction=0.5,
        area=2.353,
    ),
    Row(
        name="iwp",
        aliases=("I-WP", "schoen_iwp"),
        equation="2 sum[cosX cosY] - sum[cos2X]",
        range=(-5.0, 3.0),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-12,
        volume_fraction=0.4693,
        area=3.554,
    ),
    Row(
        name="neovius",
        aliases=("N", "C(P)"),
        equation="4 cosX cosY cosZ + 3 sum[cosX]",
        range=(-13.0, 13.0),
        symmetry=Symmetry(48, 48, 1, True),
        euler=-16,
        volume_fraction=0.5,
        area=3.524,
    ),
    Row(
        name="c_y",
        aliases=("C(Y)", "(YYxxx)*"),
        equation="-sinX sinY sinZ + sum[sin2X sinY] - cosX cosY cosZ + sum[cosX sin2Y]",
        range=(-3.535534, 3.535534),
        symmetry=Symmetry(24, 24, 1, True),
        euler=-24,
        volume_fraction=0.5,
        area=4.686,
    ),
    Row(
        name="lidinoid",
        aliases=("L", "lidinoid_nodal"),
        equation="sum[sin2X cosY sinZ] - sum[cos2X cos2Y] + 0.3",
        range=(-2.7, 2.3),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-64,
        volume_fraction=0.3846,
        area=6.239,
        note="Cubic, genus 17; the true Lidinoid is rhombohedral, genus 3. Twice the common "
        "form with 0.15; other programs use other constants, that is other levels.",
    ),
    Row(
        name="octo",
        aliases=("O,C-TO", "oc_to"),
        equation="0.6 sum[cosX cosY] - 0.4 sum[cosX] + 0.25",
        range=(-0.75, 3.25),
        symmetry=Symmetry(48, 48, 1, False),
        euler=-18,
        volume_fraction=0.4706,
        area=3.73,
    ),
    Row(
        name="frd",
        aliases=("F-RD",),
        equation="8 cosX cosY cosZ + cos2X cos2Y cos2Z - sum[cos2X cos2Y]",
        range=(-10.0, 6.0),
        symmetry=Symmetry(48, 48, 4, False),
        euler=-40,
        volume_fraction=0.4653,
        area=4.83,
    ),
    Row(
        name="s",
        aliases=("Fischer-Koch S", "S*"),
        equation="sum[cos2X sinY cosZ]",
        range=(-1.414214, 1.414214),
        symmetry=Symmetry(24, 48, 2, True),
        euler=-40,
        volume_fraction=0.5,
        area=5.43,
    ),
    Row(
        name="p_c_p",
        aliases=("P+C(P)", "PN"),
        equation="0.3 cosX cosY cosZ + 0.1 cos2X cos2Y cos2Z + 0.2 sum[cosX] + 0.1 sum[cos2X]"
        " + 0.05 sum[cos3X] + 0.1 sum[cosX cosY]",
        range=(-0.415778, 1.75),
        symmetry=Symmetry(48, 48, 1, False),
        euler=-22,
        volume_fraction=0.5842,
        area=3.758,
    ),
    Row(
        name="split_p",
        aliases=("Split P",),
        equation="1.1 sum[sin2X cosY sinZ] - 0.2 sum[cos2X cos2Y] - 0.4 sum[cos2X]",
        range=(-1.8, 1.81),
        symmetry=Symmetry(24, 24, 2, False),
        euler=-32,
        volume_fraction=0.5103,
        area=5.114,
    ),
    Row(
        name="f",
        aliases=("F*", "triplane"),
        equation="cosX cosY cosZ",
        range=(-1.0, 1.0),
        symmetry=Symmetry(48, 48, 4, True),
        euler=None,
        volume_fraction=0.5,
        area=6.0,
        singular_at_zero=True,
        disconnected=True,
        note="Three families of planes; any other level gives isolated rounded cubes.",
    ),
    Row(
        name="c_d",
        aliases=("C(D)", "C(D*)"),
        equation="cos(3X+Y) cosZ - sin(3X-Y) sinZ + cos(X+3Y) cosZ + sin(X-3Y) sinZ"
        " + cos(X-Y) cos3Z - sin(X+Y) sin3Z",
        range=(-4.242641, 4.242641),
        symmetry=Symmetry(48, 48, 4, True),
        euler=-240,
        volume_fraction=0.5,
        area=8.979,
        note="Genus 31, not that of the minimal surface; thin handles vanish at other levels.",
    ),
    Row(
        name="g_prime",
        aliases=("G'",),
        equation="sum[sin2X cosY sinZ] + 0.32",
        range=(-0.68, 1.82),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-48,
        volume_fraction=0.3693,
        area=5.515,
    ),
    Row(
        name="g_prime2",
        aliases=("G'2", "g_prime_2"),
        equation="5 sum[sin2X cosY sinZ] + sum[cos2X cos2Y]",
        range=(-6.0, 7.5),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-48,
        volume_fraction=0.5111,
        area=5.557,
    ),
    Row(
        name="d_prime",
        aliases=("D'",),
        equation="0.5 (cosX cosY cosZ + sum[sinX cosY sinZ]) - 0.5 sum[sin2X sin2Y] - 0.2",
        range=(-2.407107, 0.425),
        symmetry=Symmetry(48, 48, 4, False),
        euler=-64,
        volume_fraction=0.5322,
        area=6.247,
    ),
    Row(
        name="k",
        aliases=("Karcher K",),
        equation="0.3 (sum[cosX] + sum[cosX cosY]) - 0.4 sum[cos2X] + 0.2",
        range=(-1.6, 1.535),
        symmetry=Symmetry(48, 48, 1, False),
        euler=-22,
        volume_fraction=0.4102,
        area=3.948,
    ),
    Row(
        name="c_s",
        aliases=("C(S)", "C(S*)"),
        equation="sum[cos2X] + 2 sum[sin2X cosY sin3Z] + 2 sum[sin2X cos3Y sinZ]",
        range=(-6.454972, 6.454972),
        symmetry=Symmetry(24, 48, 2, True),
        euler=-128,
        volume_fraction=0.5,
        area=7.965,
    ),
    Row(
        name="y",
        aliases=("Y*",),
        equation="sinX sinY sinZ + sum[cosX sin2Y] + cosX cosY cosZ + sum[sin2X sinY]",
        range=(-4.949747, 4.949747),
        symmetry=Symmetry(24, 24, 1, True),
        euler=-24,
        volume_fraction=0.5,
        area=5.632,
        note="Very uneven gradient: breaks into pieces at a tenth of its range.",
    ),
    Row(
        name="pm_y",
        aliases=("±Y", "PMY", "(Fxxx)*"),
        equation="2 cosX cosY cosZ + sum[sin2X sinY]",
        range=(-2.828427, 2.828427),
        symmetry=Symmetry(24, 24, 1, True),
        euler=-40,
        volume_fraction=0.5,
        area=5.13,
    ),
    Row(
        name="c_pm_y",
        aliases=("C(±Y)", "(FFxxx)*"),
        equation="-2 cosX cosY cosZ + sum[sin2X sinY]",
        range=(-2.0, 2.0),
        symmetry=Symmetry(24, 24, 1, True),
        euler=-24,
        volume_fraction=0.5,
        area=4.493,
    ),
    Row(
        name="c_i2y",
        aliases=("C(I2-Y**)",),
        equation="2 sum[sin2X cosY sinZ] + sum[cos2X cos2Y]",
        range=(-3.0, 3.0),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-48,
        volume_fraction=0.5062,
        area=5.761,
    ),
    Row(
        name="w",
        aliases=("W*",),
        equation="sum[cos2X cosY] - sum[cosX cos2Y]",
        range=(-4.0, 4.0),
        symmetry=Symmetry(48, 48, 1, True),
        euler=None,
        volume_fraction=0.5,
        area=8.485,
        singular_at_zero=True,
        note="-2 (cosX - cosY) (cosY - cosZ) (cosZ - cosX): six families of planes at level 0.",
    ),
    Row(
        name="q_star",
        aliases=("Q*", "q"),
        equation="(cosX - 2cosY) cosZ - sqrt(3) sinZ (cos(X-Y) - cosX) + cos(X-Y) cosZ",
        range=(-4.0, 4.0),
        symmetry=Symmetry(2, 2, 1, True),
        euler=-6,
        volume_fraction=0.5484,
        area=3.435,
        level=0.2,
        singular_at_zero=True,
        hexagonal=True,
        cyclic=False,
        note="Symmetric in hexagonal axes only: place it through the cell of the tile.",
    ),
    Row(
        name="c_g",
        aliases=("C(G)", "C(Y**)"),
        equation="3 sum[sinX cosY] + 2 sum[sin3X cosY] - 2 sum[sinX cos3Y]",
        range=(-10.5, 10.5),
        symmetry=Symmetry(24, 48, 2, True),
        euler=-56,
        volume_fraction=0.5,
        area=5.798,
    ),
    Row(
        name="slotted_p",
        aliases=("Slotted P",),
        equation="-2 sum[cosX cosY] - 2 sum[cos2X] + sum[cos2X cosY] - sum[cosX cos2Y]",
        range=(-12.0, 6.0),
        symmetry=Symmetry(48, 48, 1, False),
        euler=-20,
        volume_fraction=0.4745,
        area=4.399,
    ),
    Row(
        name="double_gyroid",
        aliases=("double-g", "dg"),
        equation="2.75 sum[sin2X cosY sinZ] - sum[cos2X cos2Y] - 0.95",
        range=(-3.95, 3.175),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-16,
        volume_fraction=0.6829,
        area=4.713,
        disconnected=True,
        note="The complement is two interwoven gyroid networks.",
        source=SCAFFOLDER,
    ),
    Row(
        name="i2y",
        aliases=("I2-Y", "I2-Y**"),
        equation="-2 sum[sin2X cosY sinZ] + sum[cos2X cos2Y]",
        range=(-3.0, 3.0),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-16,
        volume_fraction=0.4446,
        area=5.384,
        disconnected=True,
        note="The solid is two interwoven networks.",
        source="von Schnering and Nesper 1991, through a public list",
    ),
    Row(
        name="double_primitive",
        aliases=("double-p", "dp"),
        equation="0.5 sum[cosX cosY] + 0.2 sum[cos2X]",
        range=(-0.6, 2.1),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-8,
        volume_fraction=0.6493,
        area=3.478,
        disconnected=True,
        note="The complement is two interwoven simple cubic networks.",
        source=SCAFFOLDER,
    ),
    Row(
        name="double_diamond",
        aliases=("double-d", "dd"),
        equation="-sum[cosX cosY] - sinX sinY sinZ",
        range=(-3.0, 1.0),
        symmetry=Symmetry(48, 48, 1, False),
        euler=-4,
        volume_fraction=0.4146,
        area=3.156,
        disconnected=True,
        note="The solid is two interwoven diamond networks, told apart in 2 x 2 x 2 cells.",
        source=SCAFFOLDER,
    ),
    Row(
        name="bcc",
        aliases=("body_centred_cubic",),
        equation="sum[cosX cosY]",
        range=(-1.0, 3.0),
        symmetry=Symmetry(48, 48, 2, False),
        euler=-12,
        volume_fraction=0.5153,
        area=3.533,
        level=-0.2,
        singular_at_zero=True,
        note="Above level 0 the complement is isolated rounded bodies.",
        source=SCAFFOLDER,
    ),
    Row(
        name="p_j",
        aliases=("PJ",),
        equation="sum[cosX] + 4 cosX cosY cosZ",
        range=(-7.0, 7.0),
        symmetry=Symmetry(48, 48, 1, True),
        euler=-16,
        volume_fraction=0.5,
        area=3.903,
        source="public lists of nodal surfaces",
    ),
    Row(
        name="d_fischer",
        aliases=("diamond_fischer",),
        equation="cos(X-Y) cosZ + sin(X+Y) sinZ",
        range=(-1.414214, 1.414214),
        symmetry=Symmetry(48, 48, 4, True),
        euler=-16,
        volume_fraction=0.5,
        area=3.838,
        note="The diamond surface with another origin.",
        source="Fischer et al. 2023, through a public list",
    ),
    Row(
        name="frd_vs",
        aliases=("frd_von_schnering", "schoen_frd"),
        equation="4 cosX cosY cosZ - sum[cos2X cos2Y]",
        range=(-7.0, 2.0),
        symmetry=Symmetry(48, 48, 4, False),
        euler=-40,
        volume_fraction=0.4323,
        area=4.852,
        source="von Schnering and Nesper 1991, through a public list",
    ),
    Row(
        name="tubular_gyroid",
        aliases=("tubular_g_c", "tgc"),
        equation="10 sum[cosX sinY] - 2 sum[cos2X cos2Y] - 12",
        range=(-27.0, 4.142136),
        symmetry=Symmetry(24, 24, 2, False),
        euler=-8,
        volume_fraction=0.8742,
        area=2.255,
        note="The complement is one slender gyroid network.",
        source=SCAFFOLDER,
    ),
    Row(
        name="tubular_gyroid_ab",
        aliases=("tubular_g_ab", "tgab"),
        equation="20 sum[cosX sinY] - 0.5 sum[cos2X cos2Y] - 4",
        range=(-34.0, 26.0),
        symmetry=Symmetry(24, 24, 2, False),
        euler=-8,
        volume_fraction=0.5672,
        area=3.07,
        source=SCAFFOLDER,
    ),
    Row(
        name="honeycomb_gyroid",
        aliases=(),
        equation="sinX cosY + sinY + cosX",
        range=(-2.0, 2.0),
        symmetry=Symmetry(8, 16, 8, True),
        euler=0,
        volume_fraction=0.5,
        area=2.952,
        singular_at_zero=True,
        disconnected=True,
        cyclic=False,
        prismatic=True,
        source=MICROGEN,
    ),
    Row(
        name="honeycomb_primitive",
        aliases=("honeycomb_schwarz_p", "honeycomb_p"),
        equation="cosX + cosY",
        range=(-2.0, 2.0),
        symmetry=Symmetry(16, 16, 8, True),
        euler=0,
        volume_fraction=0.5,
        area=2.828,
        singular_at_zero=True,
        disconnected=True,
        cyclic=False,
        prismatic=True,
        source=MICROGEN,
    ),
    Row(
        name="honeycomb_diamond",
        aliases=("honeycomb_schwarz_d", "honeycomb_d"),
        equation="cos(X-Y) + sin(X+Y)",
        range=(-2.0, 2.0),
        symmetry=Symmetry(16, 16, 16, True),
        euler=0,
        volume_fraction=0.5,
        area=4.0,
        singular_at_zero=True,
        disconnected=True,
        cyclic=False,
        prismatic=True,
        source=MICROGEN,
    ),
    Row(
        name="honeycomb_iwp",
        aliases=("honeycomb_schoen_iwp",),
        equation="cosX cosY + cosX + cosY",
        range=(-1.0, 3.0),
        symmetry=Symmetry(16, 16, 8, False),
        euler=0,
        volume_fraction=0.6304,
        area=2.162,
        disconnected=True,
        cyclic=False,
        prismatic=True,
        source=MICROGEN,
    ),
    Row(
        name="honeycomb_lidinoid",
        aliases=("honeycomb_l",),
        equation="1.1 (sin2X cosY + sin2Y sinX + cosX sinY) - (cos2X cos2Y + cos2X + cos2Y)",
        range=(-3.300676, 2.584631),
        symmetry=Symmetry(8, 8, 8, False),
        euler=0,
        volume_fraction=0.4954,
        area=4.995,
        disconnected=True,
        cyclic=False,
        prismatic=True,
        source=MICROGEN,
    ),
)
