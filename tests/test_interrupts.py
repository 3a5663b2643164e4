"""Ctrl-C: back at the prompt soon, wherever the work is, and no half-written file."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import ilattice as il

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on Unix")

#: Processor time between the signal and its exception that is allowed, in seconds.
SOON = 1.0
PROGRAM = """
import os, random, signal, sys, threading, time, traceback, warnings
import ilattice as il
warnings.simplefilter("ignore")
rng = random.Random(int(sys.argv[1]))
bar = il.Lattice("gyroid", through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1)).offset(0.1)
problem = il.cutfem.Elasticity(bar, (12, 6, 6), young=1.0).clamp("u=0")
jobs = {
    "save": lambda: bar.save("a.stl", 0.04),
    "solve": lambda: problem.load(force=(0, 0, 1.0), on="u=1").solve(),
    "sdf": lambda: il.sdf.mesh(il.sdf.parse("box gyroid shell 0.6"), 2 / 60),
    "slices": lambda: bar.slices(thickness=0.1).save("a.cli"),
}
for name, job in jobs.items():
    job()  # compiled kernels are read
    start = time.perf_counter()
    job()
    took = time.perf_counter() - start
    for file in os.listdir("."):
        os.remove(file)
    for _ in range(2):
        sent = []
        def send():
            sent.append(time.process_time())
            os.kill(os.getpid(), signal.SIGINT)
        timer = threading.Timer(rng.uniform(0.05, 0.8) * took, send)
        try:
            timer.start()
            job()
            timer.cancel()
            timer.join()
        except KeyboardInterrupt as error:
            late = time.process_time() - sent[0]
            left = [n for n in os.listdir(".") if n.startswith(".")]
            frame = traceback.extract_tb(error.__traceback__)[-1]
            print(f"{late:.3f} {len(left)} {name} in {frame.filename}:{frame.lineno}", flush=True)
"""


def test_work_ends_soon_and_leaves_nothing(tmp_path):
    """At random times, in the process itself; processor time, since machines are busy."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "5"], cwd=tmp_path, capture_output=True, text=True,
        check=False, env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    lines = [line.split(" ", 2) for line in done.stdout.splitlines()]
    assert len(lines) >= 3
    for late, left, where in lines:
        assert float(late) < SOON, where
        assert left == "0", where


def test_objects_that_were_left_half_made_are_not_told():
    """Libraries free in `__del__` what their `__init__`, interrupted, did not come to."""
    program = """
import sys
from ilattice import cli
class Half:
    def __init__(self):
        raise KeyboardInterrupt
    def __del__(self):
        self.handle
cli._main = lambda _: Half()
sys.exit(cli.main())
"""
    paths = os.pathsep.join([str(Path(il.__file__).parents[1]), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "ilattice: error: interrupted\n")


def test_commands_end_with_130_and_whole_files_only(tmp_path):
    command = [sys.executable, "-m", "ilattice", "sdf", "box", "gyroid", "shell", "0.6",
               "-s", "2/60", "-o", "a.stl"]  # fmt: skip
    paths = os.pathsep.join([str(Path(il.__file__).parents[1]), *filter(None, sys.path)])
    env = {**os.environ, "PYTHONPATH": paths}

    def start(folder):
        folder.mkdir()
        return subprocess.Popen(
            command, cwd=folder, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )

    before = time.perf_counter()
    whole = start(tmp_path / "whole")
    whole.communicate()
    assert whole.returncode == 0
    took = time.perf_counter() - before
    rng, stopped = random.Random(2), 0
    for k in range(3):
        run = start(tmp_path / str(k))
        time.sleep(rng.uniform(0.35, 1.0) * took)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
        stopped += run.returncode != 0
        # by the signal where it came within exec(): a shell says 130 for both
        assert run.returncode in (0, 130, -signal.SIGINT)
        assert b"Traceback" not in said
        for path in (tmp_path / str(k)).iterdir():
            assert path.read_bytes() == (tmp_path / "whole" / path.name).read_bytes()
    assert stopped
