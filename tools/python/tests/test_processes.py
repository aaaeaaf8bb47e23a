"""Pipes in place of files, and forks while other threads are at work."""
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import csbrdf
import numpy as np
import pytest
from conftest import GOLDEN

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here"),
    pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning"),
]
NAME = GOLDEN / "dct-opponent-mask.csbrdf"
WI = np.array([0.3, 0.1, 0.9])


def directions(count):
    wo = np.random.default_rng(2).normal(size=(count, 3))
    wo[:, 2] = abs(wo[:, 2])
    return wo


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    # In a process of its own: what waits for a pipe's other end cannot be interrupted.
    script = f"import csbrdf\ntry:\n    csbrdf.open({str(fifo)!r})\nexcept OSError as e:\n    print(e)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30)
    assert "is a pipe" in run.stdout and str(fifo) in run.stdout, run
    with pytest.raises(IsADirectoryError):
        csbrdf.open(tmp_path)
    if os.path.exists("/dev/zero"):
        with pytest.raises(OSError, match="a device"):
            csbrdf.open("/dev/zero")


def ends(child, seconds=60):
    """Whether a child process ends well and in time."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status == 0
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def test_children_work_whatever_the_parent_was_at_when_it_forked():
    brdf = csbrdf.open(NAME, cache_bytes=1)  # no block stays: every look-up takes the cache's lock
    wo = directions(3000)
    expected = brdf.eval(WI, wo)
    stop = threading.Event()

    def work():
        while not stop.is_set():
            brdf.eval(WI, wo)
            csbrdf.open(NAME).decode()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(40):
            child = os.fork()
            if child == 0:
                try:
                    right = (brdf.eval(WI, wo) == expected).all() and csbrdf.open(NAME).decode().size
                    os._exit(0 if right else 1)
                finally:
                    os._exit(2)
            assert ends(child)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert (brdf.eval(WI, wo) == expected).all()


FIRST_CALL = """
import os, sys, threading, time
import csbrdf
brdf = csbrdf.open(sys.argv[1])
thread = threading.Thread(target=brdf.decode)
thread.start()
children = []
for _ in range(8):
    child = os.fork()
    if child == 0:
        brdf.decode()
        os._exit(0)
    children.append(child)
    time.sleep(0.001)
thread.join()
assert all(os.waitpid(child, 0)[1] == 0 for child in children)
"""


def test_children_work_that_were_forked_during_the_first_call():
    # The first call starts the threads: many, so that it takes a while.
    env = dict(os.environ, RAYON_NUM_THREADS="128")
    run = subprocess.Popen([sys.executable, "-W", "ignore", "-c", FIRST_CALL, str(NAME)], env=env, start_new_session=True)
    try:
        assert run.wait(timeout=60) == 0
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        pytest.fail("a child waits for what its parent's threads had locked")


def total(count):
    return float(csbrdf.open(NAME).eval(WI, directions(count)).sum())


def test_pools_that_fork_work():
    expected = [total(count) for count in (10, 2000)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map_async(total, [10, 2000] * 4).get(timeout=120) == expected * 4
