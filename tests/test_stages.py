"""Stages are recorded in order, with the time and the memory they took."""

import sys
import time

import numpy as np
import pytest

from ilattice._stages import Stages


def work_and_fail():
    start = time.process_time()
    while time.process_time() < start + 0.05:
        pass
    raise ZeroDivisionError


def test_time_of_each_stage_also_of_one_that_fails():
    stages = Stages()
    with stages("asleep"):
        time.sleep(0.05)
    with pytest.raises(ZeroDivisionError), stages("busy"):
        work_and_fail()
    assert list(stages.records) == ["asleep", "busy"]
    assert 0.05 <= stages.records["asleep"]["seconds"] < 5
    assert 0.05 <= stages.records["busy"]["cpu_seconds"] < 5


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the peak is that since the start")
def test_peak_holds_what_was_allocated_and_freed():
    stages = Stages()
    with stages("small"):
        pass
    with stages("large"):
        np.ones(25_000_000).sum()
    small, large = (stages.records[name]["peak_memory_mb"] for name in ("small", "large"))
    assert 190 <= large - small <= 250
