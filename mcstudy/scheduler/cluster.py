"""The scheduler that a run submits to: threads of this process, or a running Dask cluster."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import dask
from distributed import Client, Scheduler, SpecCluster, Worker
from distributed.comm import core as comms
from distributed.security import Security

from mcstudy.errors import InputError
from mcstudy.fitting.compilers import cores
from mcstudy.scheduler.slurm import SlurmOptions, slurm_client

CONNECT_S = 10
"""Seconds in which a scheduler must answer."""

LAST_WORD_S = 0.3
"""Seconds more in which what went wrong may still be told."""

T = TypeVar("T")

RESTART_S = 20

COUNT_S = 2.0
"""Seconds between two counts of the threads of all workers."""

DASHBOARD_PORT = 8787


@dataclass(frozen=True)
class ClusterOptions:
    """Where to run.

    Attributes
    ----------
    workers: threads of the local scheduler; None for one per core.
    scheduler: address of a running scheduler, or None for the local one.
    dashboard: whether the local scheduler serves its dashboard, on 127.0.0.1 only.
    insecure: whether an unencrypted scheduler on another machine is accepted.
    tls_ca, tls_cert, tls_key: certificate files for a ``tls://`` scheduler.
    block_timeout: seconds a block may run; None for no limit.
    slurm: the jobs of a Slurm cluster to run in, or None.
    """

    workers: int | None = None
    scheduler: str | None = None
    dashboard: bool = False
    insecure: bool = False
    tls_ca: Path | None = None
    tls_cert: Path | None = None
    tls_key: Path | None = None
    block_timeout: float | None = None
    slurm: SlurmOptions | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.slurm is not None:
            raise InputError("--slurm and --scheduler: expected one of them")

    @property
    def here(self) -> bool:
        """Whether threads of this process compute."""
        return self.scheduler is None and self.slurm is None

    @property
    def threads(self) -> int:
        """Threads of the local scheduler."""
        return self.workers or cores()


def _loopback(host: str) -> bool:
    addresses = {str(info[4][0]).partition("%")[0] for info in socket.getaddrinfo(host, None)}
    return bool(addresses) and all(ipaddress.ip_address(a).is_loopback for a in addresses)


def _security(options: ClusterOptions) -> Security | None:
    files = {"--tls-ca": options.tls_ca, "--tls-cert": options.tls_cert, "--tls-key": options.tls_key}
    if not any(files.values()):
        return None
    for flag, file in files.items():
        if file is None or not file.is_file():
            raise InputError(f"{flag}: expected a readable PEM file, got {file}")
    return Security(
        tls_ca_file=str(options.tls_ca),
        tls_client_cert=str(options.tls_cert),
        tls_client_key=str(options.tls_key),
        require_encryption=True,
    )


class _Worker(Worker):
    """A worker that ends without waiting for a fit in progress; its files are complete or absent anyway."""

    async def close(self, *args: Any, **kwargs: Any) -> Any:
        """Close; see `distributed.Worker.close`."""
        return await super().close(*args, **{**kwargs, "executor_wait": False})


def _free(port: int) -> int:
    """``port`` if nobody listens on it, else 0: any."""
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return 0
    return port


def dashboard_url(client: Client) -> str:
    """Address of the local scheduler's dashboard."""
    cluster: Any = client.cluster
    return f"http://127.0.0.1:{cluster.scheduler.http_server.port}/status"


@contextlib.contextmanager
def _local(threads: int, dashboard: bool) -> Iterator[Client]:
    """A scheduler and one worker in this process; both listen on 127.0.0.1 only.

    By default Dask starts an HTTP server for each of them on all interfaces, even without a dashboard.
    """
    quiet: dict[str, Any] = {"distributed.worker.http.routes": []}
    if not dashboard:
        quiet["distributed.scheduler.http.routes"] = []
        # Dask's profiler samples the stack of every thread 100 times per second for the dashboard.
        quiet["distributed.worker.profile.enabled"] = False
    # Blocks have their own limit of attempts. The scheduler's limit would also fail blocks that only waited on the
    # same worker. A worker in this process is silent only when the whole process is, for instance while the machine is
    # suspended; it must not be given up then.
    limits = {"distributed.scheduler.allowed-failures": 1_000_000, "distributed.scheduler.worker-ttl": None}
    scheduler = {
        "cls": Scheduler,
        "options": {
            "protocol": "inproc://",
            "dashboard": dashboard,
            "dashboard_address": f"127.0.0.1:{_free(DASHBOARD_PORT) if dashboard else 0}",
        },
    }
    worker: dict[str, Any] = {
        "cls": _Worker,
        "options": {"nthreads": threads, "dashboard": False, "dashboard_address": "127.0.0.1:0", "memory_limit": 0},
    }
    spare = {**worker, "options": {**worker["options"], "nthreads": 1}}
    with (
        dask.config.set({**quiet, **limits}),
        SpecCluster({0: worker}, scheduler, spare, silence_logs=logging.CRITICAL) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def replace_thread(client: Client, address: str, lost: int) -> None:
    """Add one thread to the local scheduler, to replace one that a block of a worker never releases.

    ``lost``: threads of that worker that are lost by now. Without any left it is closed, or blocks would wait there.
    """
    cluster: Any = client.cluster
    cluster.worker_spec.update(cluster.new_worker_spec())
    for name, worker in list(cluster.workers.items()):
        if worker.address == address and worker.state.nthreads <= lost:
            cluster.worker_spec.pop(name, None)
    cluster.scale(len(cluster.worker_spec))


def restart_worker(client: Client, address: str) -> None:
    """Restart a worker that hangs: its nanny starts a new one; without a nanny the worker is only closed."""
    try:
        client.restart_workers([address], timeout=RESTART_S, raise_for_error=False)
    except ValueError:  # no nanny, or the worker has gone already
        dismiss_worker(client, address)


def dismiss_worker(client: Client, address: str) -> None:
    """Close a worker for good."""
    client.retire_workers([address], close_workers=True, remove=True)


class Capacity:
    """Number of threads of a scheduler's workers, counted again from time to time because workers come and go.

    ``say``: called with a message when there are no workers.
    """

    def __init__(self, client: Client, say: Callable[[str], None]) -> None:
        self._client, self._say = client, say
        self._counted, self._threads, self._warned = -math.inf, 1, False

    def threads(self) -> int:
        """The latest count, at least 1."""
        now = time.monotonic()
        if now > self._counted + COUNT_S:
            try:
                n_threads = sum(self._client.nthreads().values())
            except OSError:  # the connection is being lost; the client's status will show it
                return self._threads
            if not n_threads and not self._warned:
                self._say("the scheduler has no workers; waiting for workers (Ctrl-C stops; the run can be resumed)")
            self._counted, self._threads, self._warned = now, max(1, n_threads), not n_threads
        return self._threads


def reach(options: ClusterOptions) -> Security | None:
    """Certificates for the given scheduler, which has answered; raises `InputError` when none does in `CONNECT_S`."""
    address, end = str(options.scheduler), time.monotonic() + CONNECT_S
    try:
        parts = urlsplit(address)
        host, usable = parts.hostname, parts.scheme in ("tcp", "tls") and parts.hostname and parts.port
    except ValueError:  # a port that is no number, or too large
        host, usable = None, None
    if not host or not usable:
        raise InputError(f"--scheduler: expected tcp://HOST:PORT or tls://HOST:PORT, PORT 1 to 65535, got {address}")
    try:
        security = _security(options)
        if parts.scheme == "tls" and security is None:
            raise InputError("--tls-ca, --tls-cert, --tls-key: expected PEM files for a tls:// scheduler, got none")
        if parts.scheme == "tcp" and not options.insecure and not _before(end, lambda: _loopback(host)):
            raise InputError(
                f"--scheduler: expected tls:// for {host}, which is another machine "
                "(anyone who can reach an unencrypted scheduler can run code; --insecure accepts this risk)"
            )
        service = _before(end, lambda: asyncio.run(_kind(address, security, end - time.monotonic())))
    except InputError:
        raise
    except OSError as error:
        raise _unreachable(address, error) from None
    except Exception:  # of a decoder: what was read is of another service
        raise _unreachable(address, OSError("what answers there is no Dask scheduler")) from None
    if service != "Scheduler":
        raise _unreachable(address, OSError(f"found a {service} of Dask"))
    return security


def _unreachable(address: str, error: Exception) -> InputError:
    """What is said of an address where no scheduler can be used."""
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(f"--scheduler: expected a running scheduler at {address} ({reason})")


async def _kind(address: str, security: Security | None, seconds: float) -> str:
    """What kind of server says that it listens at an address."""
    async with asyncio.timeout(seconds):
        comm = await comms.connect(address, seconds, **(security or Security()).get_connection_args("client"))
        try:
            await comm.write({"op": "identity", "reply": True})
            return str((await comm.read())["type"])
        finally:
            comm.abort()


def _before(end: float, work: Callable[[], T]) -> T:
    """The result of ``work``, done in a thread that is left alone when it takes longer than until ``end``."""
    future = Future[T]()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name="mcstudy-reach", daemon=True).start()
    try:
        return future.result(max(0.0, end - time.monotonic()) + LAST_WORD_S)
    except TimeoutError:
        raise TimeoutError(f"no Dask scheduler answered in {CONNECT_S:g} s") from None


@contextlib.contextmanager
def connect(options: ClusterOptions, say: Callable[[str], None] | None = None) -> Iterator[Client]:
    """A client of the local or the given scheduler; raises `InputError` when the latter is not usable.

    ``say``: told where the local one's dashboard is, if it has one.
    """
    # Dask's own messages are silenced: problems with workers and schedulers are reported here, one line each.
    for name in [n for n in logging.root.manager.loggerDict if n.split(".")[0] == "distributed"]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    if options.slurm is not None:
        with slurm_client(options.slurm) as client:
            yield client
        return
    if options.scheduler is None:
        with _local(options.threads, options.dashboard) as client:
            if options.dashboard and say:
                say(f"dashboard: {dashboard_url(client)}")
            yield client
        return
    security = reach(options)
    try:
        client = Client(options.scheduler, security=security, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TypeError, ValueError) as error:
        raise _unreachable(options.scheduler, error) from None
    with client:
        yield client
