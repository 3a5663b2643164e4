"""Settings of the whole suite."""

import os

import numba
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "ilattice",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("ilattice")

os.environ.setdefault("ILATTICE_PATIENCE", "inf")  # say nothing of compiling, here and in children

ALL = numba.config.NUMBA_NUM_THREADS
SHARE = max(1, ALL // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
numba.set_num_threads(SHARE)  # for fixtures of modules


@pytest.fixture(autouse=True)
def threads(request):
    """Processes side by side share the cores: threads that wait for each other cost more."""
    numba.set_num_threads(ALL if request.node.get_closest_marker("threads") else SHARE)
