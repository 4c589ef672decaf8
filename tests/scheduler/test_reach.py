"""Whatever listens where a scheduler should be: one line, in the time in which nothing that listens takes one."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster

from mcstudy.errors import InputError
from mcstudy.scheduler import cluster
from mcstudy.scheduler.cluster import ClusterOptions, reach
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

LIMIT_S = 0.7
MARGIN_S = 5.0
"""Of a busy machine; without the limit they would wait for ever."""

Answer = Callable[[socket.socket], object]


def flood(asked: socket.socket) -> None:
    while True:
        asked.sendall(os.urandom(1 << 16))


ANSWERS: dict[str, Answer] = {
    "says nothing": lambda asked: asked.recv(1 << 20) and time.sleep(60),
    "does not even read": lambda _: time.sleep(60),
    "closes": socket.socket.close,
    "web server": lambda asked: asked.sendall(b"HTTP/1.0 400 Bad request\r\n\r\n<html>") or time.sleep(60),
    "banner": lambda asked: asked.sendall(b"SSH-2.0-OpenSSH_9.6\r\n") or time.sleep(60),
    "one frame that never ends": lambda asked: asked.sendall((1).to_bytes(8, "little") * 2 + b"x") or time.sleep(60),
    "noise without an end": flood,
}


@contextlib.contextmanager
def service(answer: Answer) -> Iterator[str]:
    """Address of a service that answers so."""

    def one(asked: socket.socket) -> None:
        with contextlib.suppress(OSError), asked:
            answer(asked)

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                threading.Thread(target=one, args=(server.accept()[0],), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize("kind", ANSWERS)
def test_another_service_is_one_line_within_the_limit(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", LIMIT_S)
    with service(ANSWERS[kind]) as address:
        begun = time.monotonic()
        with pytest.raises(InputError, match=rf"^--scheduler: expected a running scheduler at {address} \([^\n]+\)$"):
            reach(ClusterOptions(scheduler=address))
        assert time.monotonic() - begun < LIMIT_S + MARGIN_S


@pytest.mark.parametrize(
    "address",
    [
        *(f"tcp://127.0.0.1{port}" for port in (":99999", ":-1", ":0", ":x", "")),
        *("tcp://[::1:8786", "tcp://:8786", "http://127.0.0.1:8786", "ucx://127.0.0.1:8786", "127.0.0.1:8786", ""),
    ],
)
def test_what_is_no_address_of_a_scheduler_is_one_line(address: str) -> None:
    with pytest.raises(InputError, match=r"^--scheduler: expected tcp://HOST:PORT or tls://HOST:PORT, [^\n]+$"):
        reach(ClusterOptions(scheduler=address))


def test_a_host_without_an_address_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(
        InputError, match=r"expected a running scheduler at tcp://nowhere:1 .*Name or service not known"
    ):
        reach(ClusterOptions(scheduler="tcp://nowhere:1"))


def test_a_name_server_that_is_silent_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", LIMIT_S)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_: time.sleep(60))
    begun = time.monotonic()
    with pytest.raises(InputError, match=r"no Dask scheduler answered in 0\.7 s"):
        reach(ClusterOptions(scheduler="tcp://nowhere:1"))
    assert time.monotonic() - begun < LIMIT_S + MARGIN_S


def test_a_worker_is_no_scheduler_and_a_scheduler_is_one() -> None:
    with LocalCluster(n_workers=1, processes=False, protocol="tcp", dashboard_address=None) as made:
        reach(ClusterOptions(scheduler=made.scheduler_address))
        with pytest.raises(InputError, match="found a Worker of Dask"):
            reach(ClusterOptions(scheduler=made.workers[0].address))


def test_a_scheduler_that_cannot_be_used_leaves_no_cube_behind(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", LIMIT_S)
    with service(ANSWERS["says nothing"]) as address, pytest.raises(InputError, match="expected a running scheduler"):
        run_study(parse_study(tiny), tmp_path / "out.zarr", ClusterOptions(scheduler=address))
    assert list(tmp_path.iterdir()) == []
