"""Cases of constants of compiled code, run in a process of its own in which kernels are Python.

Compiled code has its constants baked in. A file of tests has rows of a module, a constant, a value
of no use, a case that holds with the right one, and what it says with the other; run as a program,
it tries both.
"""

import ast
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import ilattice as il


def constants(module, kinds=(int, float)):
    """Names of capitals that a module gives numbers to, of these kinds if they are single ones."""
    path = importlib.import_module(f"ilattice.{module}").__file__
    out = set()
    for node in ast.parse(Path(path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign):
            numbers = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
            names = [n.id for n in ast.walk(node.targets[0]) if isinstance(n, ast.Name)]
            if any(type(n) in kinds for n in numbers) and "".join(names).replace("_", "").isupper():
                out.update(names)
    return out


def said(case):
    """What a case says of itself: nothing, or how it fails."""
    try:
        case()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def holders(module, name):
    """The module of a constant and the modules of kernels that have imported it, and its value."""
    home = importlib.import_module(f"ilattice.{module}")
    value = getattr(home, name)
    kernels = [m for k, m in sys.modules.items() if "._kernels" in k and k.startswith("ilattice.")]
    return [m for m in kernels if getattr(m, name, None) is value], value


def write(room, cases):
    """Write what all cases of a room say, without and with the useless value."""
    np.seterr(all="ignore")
    right, out = {}, []
    for module, name, useless, case, _ in cases:
        if case not in right:
            right[case] = said(case)
        modules, value = holders(f"{room}.{module}", name)
        for m in modules:
            setattr(m, name, useless)
        out.append([right[case], said(case)])
        for m in modules:
            setattr(m, name, value)
    sys.stdout.write(json.dumps(out))


def results_of(file):
    """What the cases of a file say, from a process in which kernels are not compiled."""
    paths = os.pathsep.join(map(str, (Path(il.__file__).parents[1], Path(__file__).parent)))
    done = subprocess.run(
        [sys.executable, file], capture_output=True, text=True, check=False,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": paths},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
