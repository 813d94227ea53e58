"""Who builds tables: processes of this machine, or a dask.distributed cluster, both as `concurrent.futures.Executor`.

Processes are started anew and use one BLAS thread each: matrices are small, and idle spinning threads cost the other
processes their time. So this module must load no NumPy: a worker reads it before it sets the number of threads.
Source: design 8.
"""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

from drivers.errors import InputError

LOCAL = "local"
"""Instead of an address: a cluster of processes on this machine."""
TIMEOUT = "10s"
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@contextlib.contextmanager
def process_pool(workers: int | None = None) -> Iterator[Executor]:
    """Pool of `workers` processes (None: one a core) that leave Ctrl-C to this one; left by an exception, or when
    this process dies, they end at once."""
    _check(workers)
    context = multiprocessing.get_context("spawn")
    here, ours = context.Pipe(duplex=False)
    with here, ours:
        pool = ProcessPoolExecutor(workers, context, _prepare_worker, (here,))
        try:
            yield pool
        except BaseException:
            ours.close()  # whoever leaves early waits for nobody's work
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def cluster(address: str, workers: int | None = None) -> Iterator[Executor]:
    """The cluster whose scheduler listens at `address` (tcp://host:port), or for "local" one of `workers` processes
    here. Errors: InputError when it cannot be reached, or distributed is not installed."""
    try:
        distributed: Any = importlib.import_module("distributed")  # its functions have no types
    except ImportError as error:
        raise InputError(
            "a cluster needs the package distributed.", help="Install it: pip install 'stillgrasp[cluster]'."
        ) from error
    _check(workers)
    with contextlib.ExitStack() as stack:
        try:
            if address == LOCAL:
                started = distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # without one it still takes a fixed port
                )
                address = stack.enter_context(started).scheduler_address
            client = stack.enter_context(distributed.Client(address, timeout=TIMEOUT, set_as_default=False))
        except (OSError, ValueError) as error:
            raise InputError(
                f"no cluster at {address!r}: {error}.",
                help="Start `dask scheduler` and `dask worker`, and give the scheduler's address (tcp://host:8786).",
            ) from error
        yield client.get_executor(pure=False)


def _check(workers: int | None) -> None:
    if workers is not None and not 1 <= workers <= 1024:
        raise InputError(f"{workers} workers are not between 1 and 1024.", help="One a core is a good number.")


def _prepare_worker(owner: Connection) -> None:
    """First thing in a worker process; the other end of `owner` is open as long as anybody wants work from here."""
    os.environ.update(ONE_THREAD)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with, args=(owner,), daemon=True).start()


def _leave_with(owner: Connection) -> None:
    """Without this, the workers of a pool whose process is killed would wait for work for ever."""
    owner.poll(None)  # nobody sends: it returns at end-of-file
    os._exit(1)
