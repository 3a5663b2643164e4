"""One page about an analysis: set-up, checks, results and pictures, as an HTML file by itself.

Guarantees: nothing is loaded from elsewhere, pictures are in the file; what makes a result doubtful
stands first; the file is written as a whole or not at all.
"""

import base64
import html
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np

from ilattice._files import as_path, atomic_write
from ilattice._validate import as_flag
from ilattice.cutfem import integration
from ilattice.cutfem.conditions import AXES
from ilattice.cutfem.output import Result
from ilattice.cutfem.places import Motion
from ilattice.cutfem.regions import Region
from ilattice.cutfem.stresses import margins
from ilattice.errors import FormatError, InputError
from ilattice.linalg.solvers import SolveReport
from ilattice.plot import Scene

#: Part of the energy that the cells may be off, and part of what acts that may be out of balance,
#: before the page says so at its top.
DOUBTFUL, UNBALANCED = 0.02, 1e-6
SIZE = (1000, 750)
STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;
color:#222}h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:1.6rem}table{border-collapse:collapse}
td,th{padding:.15rem .9rem .15rem 0;text-align:left;vertical-align:top;border-bottom:1px solid #ddd}
img{max-width:49%}.caution{background:#fff0d0;padding:.5rem .8rem;border-left:4px solid #d08000}"""


@dataclass(frozen=True, eq=False)
class Report(SolveReport):
    """How a system was solved; called with a path, it writes a page about the whole analysis."""

    _result: Any = field(default=None, repr=False)

    @property
    def splines(self) -> str:
        """Degree and smoothness, and why they were chosen if nobody gave a degree."""
        return _splines(self._result.problem.domain)

    @property
    def unseen(self) -> float:
        """Diameter of the largest speck or void that may pass unseen, in lengths of a cell.

        0 for splines, and for fields that tell bounds of themselves; see `CutGrid.unseen`.
        """
        return float(max(cut.unseen for cut in self._result.problem.domain.solids))

    @property
    def integration_error(self) -> float:
        """Estimated part of the energy by which it is off because of the points of rules.

        In cells that curved surfaces cut, rules are not exact. It is found when it is asked for, by
        rules with three more points per direction, in about the time that the rules have taken; of
        rules with two or three points it is in `discretization_error`, too, by some of the cells.
        Struts of a cell are up to 2 % off at degree 1, 0.2 % at degree 2 and 0.05 % at degree 3,
        where splines may have the solution exactly, as in tension. Finer cells make it small, and
        so does ``q``. Loads on bodies are off likewise; fields of points are, by `CutGrid.error`,
        besides.
        """
        problem, c = self._result.problem, self._result.coefficients
        return integration.relative_error(problem, c, problem._solid_energy(c))

    def __call__(self, path: str | PathLike[str], *, pictures: bool = True) -> None:
        """Write a page about the analysis: set-up, checks, results, pictures.

        Parameters
        ----------
        path : path-like
            File ending in ``.html``.
        pictures : bool
            Whether there are pictures.

        Raises
        ------
        FormatError
            Another ending, or the file cannot be written.
        """
        file = as_path("path", path)
        if file.suffix.lower() not in (".html", ".htm"):
            raise FormatError(f"reports are pages: {str(path)!r} must end in .html")
        text = page(self._result, self, file.stem, pictures=as_flag("pictures", pictures))
        with atomic_write(file, text=True) as out:
            out.write(text)


def report_of(result: Any, solved: SolveReport | None) -> Report | None:
    """What the solver told, able to write about a result."""
    if solved is None:
        return None
    told = {name: value for name, value in vars(solved).items() if not name.startswith("_")}
    return Report(**told, _result=result)


def page(result: Result, report: Report, title: str, *, pictures: bool) -> str:
    """The text of the page."""
    kind = type(result.problem).__name__
    parts = [
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{_text(title)}</title>",
        f"<style>{STYLE}</style></head><body><h1>{_text(title)}: {_text(kind)}</h1>",
        *(f"<p class='caution'>{_text(caution)}</p>" for caution in _cautions(result, report)),
        "<h2>Results</h2>", _table(_results(result)),
    ]  # fmt: skip
    if pictures:
        parts += [f"<p>{''.join(_pictures(result))}</p>"]
    parts += [
        "<h2>Set-up</h2>", _table(_set_up(result.problem)),
        "<h2>Checks</h2>", _table(_checks(result, report)),
    ]  # fmt: skip
    for name in ("reactions", "inflow"):
        rows = _asked(result, name)
        if rows:
            table = {str(k): _number(v) for k, v in rows.items()}
            parts += [f"<h2>{name.capitalize()}</h2>", _table(table)]
    return "\n".join([*parts, "</body></html>\n"])


def _cautions(result: Result, report: SolveReport) -> list[str]:
    """What a reader has to know before believing the numbers."""
    out, error = [], report.discretization_error
    if not error <= DOUBTFUL:
        out.append(
            "The energy may be off because of the size of the cells; estimate: "
            f"{_per_cent(error)}. Use more cells, or another degree, and compare."
        )
    parts = result.problem.domain.parts
    loose = parts.seen(result.problem.parts[1])
    if len(loose):
        out.append(f"Left out, because nothing holds them: {parts.describe(loose)}.")
    balance = float(getattr(result, "equilibrium", 0.0))
    if not balance <= UNBALANCED:
        out.append(f"Loads and reactions are out of balance by {balance:.1e} of what acts.")
    factor = _asked(result, "safety_factor")
    if factor is not None and factor < 1.0:
        out.append(f"The material yields: the safety factor is {factor:.3g}.")
    return out


def _results(result: Result) -> dict[str, str]:
    """Numbers about the whole."""
    out = {name: _number(value) for name, value in result.field_data().items()}
    for name in ("energy", "compliance"):
        value = _asked(result, name)
        if value is not None:
            out[name] = _number(value)
    rule = result.problem.domain.solid(result.problem.assembly)
    assert rule.parameters is not None
    data = result.point_data(rule.parameters)
    for name, values in data.items():
        if values.ndim == 1:
            out[name] = f"{_number(values.min())} to {_number(values.max())}"
        elif values.shape[1] == 3:
            out[f"largest {name}"] = _number(np.linalg.norm(values, axis=1).max())
    factor = _asked(result, "safety_factor")
    if factor is not None:
        out["safety factor"] = _number(factor)
    return out


def _set_up(problem: Any) -> dict[str, str]:
    """Solid, grid, material, supports and loads."""
    domain = problem.domain
    rule = domain.solid(problem.assembly)
    low, high = rule.points.min(axis=0), rule.points.max(axis=0)
    out = {
        "volume": _number(rule.weights.sum()),
        "points of quadrature": f"{len(rule)}, from {_number(low)} to {_number(high)}",
        "cells": "x".join(map(str, domain.cut.grid.shape)),
        "splines": _splines(domain),
    }
    out |= {name: _said(value) for name, value in problem._told.items()}
    where = _Where(domain)
    for i, s in enumerate(problem.supports, 1):
        axes = "".join(a for a, held in zip(AXES, s.mask, strict=False) if held)
        what = "along the normal" if s.normal else axes if problem.m > 1 else "value"
        out[f"support {i}"] = (
            f"{where(s.on)}: {what} = {_said(s.value)}, {'weakly' if s.weak else 'exactly'}"
        )
    for c in getattr(problem, "connections", ()):
        out[f"rigid at {where(c.on)}"] = f"force {_said(c.force)}, moment {_said(c.moment)}"
    for i, spring in enumerate(problem.springs, 1):
        out[f"spring {i}"] = f"{where(spring.on)}: stiffness {_said(spring.stiffness)} per area"
    for i, load in enumerate(problem.loads, 1):
        out[f"load {i}"] = f"{load.kind} {_said(load.value)}" + (
            f" at {where(load.on)}" if load.on else ""
        )
    return out


def _splines(domain: Any) -> str:
    """Degree and smoothness, and why."""
    why = f" (chosen: {domain.chosen})" if domain.chosen else ""
    return f"degree {domain.degree}, smoothness {domain.smoothness}{why}"


@dataclass(frozen=True)
class _Where:
    """What places are called, those that a function picks with the box they are in."""

    domain: Any

    def __call__(self, on: Any) -> str:
        if not isinstance(on, Region) or on.planes is not None:
            return str(on)
        x = self.domain.boundary(on).points
        return f"{on} (from {_number(x.min(axis=0))} to {_number(x.max(axis=0))})"


def _checks(result: Result, report: Report) -> dict[str, str]:
    """How far the numbers can be believed."""
    error = report.discretization_error
    out = {
        "error of the energy by the cells": _per_cent(error),
        "error of the energy by integration": _per_cent(report.integration_error),
        "error of the volume": _per_cent(result.problem.domain.cut.error),
        "solver": f"{report.method}, {report.size} unknowns, {report.iterations} iterations, "
        f"{report.setup_seconds + report.solve_seconds:.2g} s",
        "relative residual": f"{report.residual:.1e}",
    }
    unseen = max(cut.unseen for cut in result.problem.domain.solids)
    if unseen > 0.0:
        out["specks and voids that a function of points may hide"] = f"up to {unseen:.2g} cells"
    balance = getattr(result, "equilibrium", None)
    if balance is not None:
        out["loads and reactions out of balance"] = f"{balance:.1e} of what acts"
    return out


def _pictures(result: Result) -> Iterable[str]:
    """Two views of the solid, in the file itself."""
    from PIL import Image

    grid = result.to_pyvista(scale="auto")
    shown: dict[str, Any] = {"scalars": result.shown}
    drawn = [((-60.0, 30.0), shown), ((120.0, 20.0), shown)]
    if "utilization" in grid.point_data:
        drawn.append((drawn[0][0], margins(grid)))
    for view, style in drawn:
        image = Scene(size=SIZE, view=view).add(grid, **style).image()
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, "PNG", optimize=True)
        data = base64.b64encode(buffer.getvalue()).decode("ascii")
        yield f"<img alt='{_text(style['scalars'])}' src='data:image/png;base64,{data}'>"


def _per_cent(part: float) -> str:
    """A part in per cent, if it is known."""
    return "none" if math.isnan(part) else f"{100 * part:.2g} %"


def _asked(result: Any, name: str) -> Any:
    """What not every result has, or None."""
    try:
        return getattr(result, name, None)
    except InputError:  # no strength was given; nothing has flown yet
        return None


def _said(value: Any) -> str:
    """A value as its user gave it."""
    if isinstance(value, Motion):
        return str(value)
    if callable(value):
        return str(getattr(value, "__name__", type(value).__name__)) + "(x)"
    return _number(value)


def _number(value: Any) -> str:
    """Numbers with five digits."""
    try:
        a = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return str(value)
    if a.ndim == 0:
        return f"{float(a):.5g}"
    return "(" + ", ".join(f"{v:.5g}" for v in a.ravel().tolist()) + ")"


def _table(rows: Mapping[str, str]) -> str:
    """Two columns."""
    cells = (f"<tr><th>{_text(k)}</th><td>{_text(v)}</td></tr>" for k, v in rows.items())
    return f"<table>{''.join(cells)}</table>"


def _text(value: Any) -> str:
    return html.escape(str(value))
