"""A headless Chromium to look at a page with, driven over its debugging socket (tornado comes with distributed)."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tornado.websocket import WebSocketClientConnection, websocket_connect

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
)
PATIENCE_S = 90


def chromium() -> str | None:
    """Path of a Chromium, or None."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@dataclass
class Seen:
    """What a page did: console messages of level error or warning, uncaught exceptions, URLs asked for."""

    complaints: list[str] = field(default_factory=list)
    urls: list[str] = field(default_factory=list)


class Browser:
    """A browser with one page; use as a context manager."""

    def __enter__(self) -> Self:
        self._folder = tempfile.mkdtemp()
        self._process = subprocess.Popen(
            [str(chromium()), *FLAGS, f"--user-data-dir={self._folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._loop = asyncio.new_event_loop()
        self.seen = Seen()
        self._answers: dict[int, dict[str, Any]] = {}
        self._last = 0
        self._loaded = False
        try:
            self._socket: WebSocketClientConnection = self._loop.run_until_complete(self._connect())
            target = self.send("Target.createTarget", url="about:blank")["targetId"]
            self._session = None
            self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Page", "Runtime", "Log", "Network"):
                self.send(f"{domain}.enable")
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    _session: str | None = None

    async def _connect(self) -> WebSocketClientConnection:
        port_file, end = Path(self._folder, "DevToolsActivePort"), time.monotonic() + PATIENCE_S
        while not (port_file.exists() and len(port_file.read_text().splitlines()) == 2):
            if time.monotonic() > end or self._process.poll() is not None:
                raise RuntimeError("Chromium did not start")
            await asyncio.sleep(0.05)
        port, path = port_file.read_text().splitlines()
        return await websocket_connect(f"ws://127.0.0.1:{port}{path}", max_message_size=200_000_000)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if hasattr(self, "_socket"):
            self._loop.run_until_complete(self._close())
        self._loop.close()
        self._process.terminate()
        self._process.wait(30)
        shutil.rmtree(self._folder, ignore_errors=True)

    async def _close(self) -> None:
        self._socket.close()
        await asyncio.sleep(0.05)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the DevTools protocol, and its result."""
        self._last += 1
        message: dict[str, Any] = {"id": self._last, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        number = self._last
        self._loop.run_until_complete(self._write(json.dumps(message)))
        self._until(lambda: number in self._answers)
        answer = self._answers.pop(number)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return dict(answer["result"])

    async def _write(self, text: str) -> None:
        await self._socket.write_message(text)

    async def _read(self) -> str | bytes | None:
        return await self._socket.read_message()

    def _until(self, done: Any) -> None:
        end = time.monotonic() + PATIENCE_S
        while not done():
            left = end - time.monotonic()
            if left <= 0:
                raise TimeoutError("Chromium did not answer")
            text = self._loop.run_until_complete(asyncio.wait_for(self._read(), left))
            if text is None:
                raise RuntimeError("Chromium closed the connection")
            message = json.loads(text)
            if "id" in message:
                self._answers[message["id"]] = message
            else:
                self._note(message["method"], message.get("params", {}))

    def _note(self, event: str, p: dict[str, Any]) -> None:
        if event == "Network.requestWillBeSent":
            self.seen.urls.append(p["request"]["url"])
        elif event == "Runtime.exceptionThrown":
            self.seen.complaints.append(str(p["exceptionDetails"].get("text")))
        elif event == "Runtime.consoleAPICalled" and p["type"] in ("error", "warning", "assert"):
            self.seen.complaints.append(json.dumps(p["args"]))
        elif event == "Log.entryAdded" and p["entry"]["level"] in ("error", "warning"):
            self.seen.complaints.append(p["entry"]["text"])
        elif event == "Page.loadEventFired":
            self._loaded = True

    def open(self, page: Path, width: int = 1600, height: int = 1000, scheme: str = "light") -> Seen:
        """Load a local page at a window size and colour scheme; returns what it did meanwhile."""
        self.seen, self._loaded = Seen(), False
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        self.send("Page.navigate", url=page.resolve().as_uri())
        self._until(lambda: self._loaded)
        return self.seen

    def evaluate(self, script: str) -> Any:
        """Value of a JavaScript expression in the page; of a promise, what it comes to."""
        result = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in result:
            raise RuntimeError(str(result["exceptionDetails"]))
        return result["result"].get("value")

    def screenshot(self, file: Path, selector: str = "body") -> None:
        """PNG of one element."""
        box: Sequence[float] = self.evaluate(
            f"(()=>{{const r=document.querySelector({json.dumps(selector)}).getBoundingClientRect();"
            "return [r.x+scrollX,r.y+scrollY,r.width,r.height]})()"
        )
        clip = dict(zip(("x", "y", "width", "height"), box, strict=True))
        shot = self.send("Page.captureScreenshot", clip={**clip, "scale": 1}, captureBeyondViewport=True)
        file.write_bytes(base64.b64decode(shot["data"]))

    def printed(self) -> bytes:
        """The page as PDF, on the paper that its style asks for."""
        return base64.b64decode(self.send("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])
