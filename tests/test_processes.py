"""Workers: Ctrl-C, which a terminal sends to all of them, is their parent's; none of them outlives it."""

import os
import signal
import subprocess
import sys
import time

import pytest

# A pool whose workers say who they are, then wait for a minute each. Interrupted while it starts, a worker would end
# with a traceback; while it works, it would say so.
SCRIPT = """
import os, signal, time
from jaxgeo.processes import WorkerPool

def prepare():
    time.sleep(1)

def wait():
    try:
        print(os.getpid(), flush=True)
        time.sleep(60)
    except KeyboardInterrupt:
        print("worker interrupted", flush=True)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background of a shell ignores it
    with WorkerPool(2, prepare) as pool:
        try:
            waiting = [pool.submit(wait) for _ in range(2)]
            print("begun", flush=True)
            waiting[0].result()
        except KeyboardInterrupt:
            time.sleep(0.5)
            for process in pool._processes.values():
                process.terminate()
            print("interrupted", flush=True)
"""


@pytest.fixture
def parent(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout.readline() == "begun\n"
    yield process
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


@pytest.mark.parametrize("started", [False, True])
def test_an_interrupt_reaches_the_parent_alone(parent, started):
    if started:
        assert parent.stdout.readline().strip().isdecimal()
    else:
        time.sleep(1.0)
    os.killpg(parent.pid, signal.SIGINT)
    said, errors = parent.communicate(timeout=60)
    assert "interrupted" in said.splitlines()
    assert "worker interrupted" not in said
    assert "KeyboardInterrupt" not in errors
    assert parent.returncode == 0


def test_workers_end_with_a_parent_that_is_killed(parent):
    workers = [int(parent.stdout.readline()) for _ in range(2)]
    parent.kill()
    parent.wait()
    until = time.monotonic() + 30
    while alive := [pid for pid in workers if _alive(pid)]:
        assert time.monotonic() < until, f"{alive} live on"
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    """Whether a process is there and no zombie, which nobody may be there to bury."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
