"""``--dashboard`` serves Dask's own page on this machine, and without it nothing is served."""

from __future__ import annotations

from urllib.error import URLError
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest

from mcstudy.scheduler.cluster import ClusterOptions, connect, dashboard_url


def test_the_dashboard_answers_on_loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mcstudy.scheduler.cluster.DASHBOARD_PORT", 0)  # the usual one is soon another test's
    with connect(ClusterOptions(workers=1, dashboard=True)) as client:
        url = dashboard_url(client)
        assert urlsplit(url).hostname == "127.0.0.1"
        with urlopen(url, timeout=60) as answer:
            assert answer.status == 200
            assert b"Dask" in answer.read()
    with pytest.raises(URLError):
        urlopen(url, timeout=5)
