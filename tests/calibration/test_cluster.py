"""Pools of processes and a real cluster on this machine, both through the one interface that the build knows."""

import os
import select
import signal
import subprocess
import sys
from concurrent.futures import as_completed

import pytest

from calibration.cluster import cluster, process_pool
from drivers.errors import InputError


def test_a_worker_has_one_blas_thread() -> None:
    """The number is set before NumPy can be loaded, without touching this process."""
    before = os.environ.get("OPENBLAS_NUM_THREADS")
    with process_pool(1) as pool:
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result(30) == "1"
    assert os.environ.get("OPENBLAS_NUM_THREADS") == before
    loaded = "import calibration.cluster, sys; print('numpy' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True, timeout=60)
    assert shown.stdout.strip() == "False"


def test_workers_end_with_the_process_that_was_killed() -> None:
    """Killed without a chance to clear up, a pool leaves no process behind."""
    program = (
        "import os, sys, time\n"
        "from calibration.cluster import process_pool\n"
        "if __name__ == '__main__':\n"
        "    with process_pool(1) as pool:\n"
        "        print(pool.submit(os.getpid).result(), flush=True)\n"
        "        time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        worker = int(owner.stdout.readline())
        owner.kill()
    assert _ends(worker, within_s=20)


def test_a_real_cluster_on_this_machine_serves_concurrent_futures() -> None:
    """Scheduler and worker processes on 127.0.0.1, driven by `submit` and `as_completed` alone; errors come back."""
    with cluster("local", 1) as executor:
        futures = {executor.submit(divmod, 7, divisor): divisor for divisor in (1, 2, 0)}
        results = {futures[future]: future.exception() or future.result() for future in as_completed(futures, 30)}
    assert (results[1], results[2]) == ((7, 0), (3, 1))
    assert isinstance(results[0], ZeroDivisionError)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x"])
def test_a_cluster_that_is_not_there_is_an_error(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The address, and what to do."""
    monkeypatch.setattr("calibration.cluster.TIMEOUT", "300ms")
    with pytest.raises(InputError, match="dask scheduler"), cluster(address):
        pass


def test_bad_numbers_of_workers_are_refused() -> None:
    """Before any process is started."""
    with pytest.raises(InputError, match="1024"), process_pool(0):
        pass


def _ends(pid: int, *, within_s: float) -> bool:
    """Wait for the end of a process that is not our child; kill it when it does not come."""
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        if select.select([handle], [], [], within_s)[0]:
            return True
        signal.pidfd_send_signal(handle, signal.SIGKILL)
        return False
    finally:
        os.close(handle)
