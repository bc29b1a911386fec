"""A real browser for the tests: Debian's chromium, driven over its own protocol, no driver needed."""

import asyncio
import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import WebSocketClientConnection, websocket_connect

T = TypeVar("T")

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-port=0",
)  # fmt: skip
_START_SECONDS = 60

# the usual judge of accessibility; ``make test-all`` fetches it
AXE = Path(sys.prefix, "share", "axe-core", "package", "axe.min.js")
AXE_RUN = """
axe.run(document, {resultTypes: ["violations"]}).then(found => JSON.stringify(found.violations.map(rule =>
  `${rule.id}: ` + rule.nodes.slice(0, 3).map(node => node.target + " " + node.failureSummary).join("; "))))
"""
PHONE, A4, DESK = 360, 688, 1280


def find_browser() -> str | None:
    """The browser's path; ``make test-all`` installs one where it may."""
    return next((path for name in _NAMES if (path := shutil.which(name))), None)


@dataclass
class Page:
    """An open page and everything that happened on it."""

    socket: WebSocketClientConnection
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    dialogs: list[str] = field(default_factory=list)
    loaded: bool = False
    judge_is_awake: bool = False
    _number: Any = field(default_factory=lambda: itertools.count(1))

    def _note(self, method: str, event: dict[str, Any]) -> None:
        match method:
            case "Network.requestWillBeSent" if not event["request"]["url"].startswith("data:"):
                self.requests.append(event["request"]["url"])
            case "Page.javascriptDialogOpening":
                self.dialogs.append(event["message"])
            case "Log.entryAdded" | "Runtime.exceptionThrown" | "Runtime.consoleAPICalled":
                self.complaints.append(json.dumps(event)[:300])
            case "Page.loadEventFired":
                self.loaded = True

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._number)
        await self.socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        return await self._read(lambda message: message.get("id") == number)

    async def _read(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        while True:
            text = await asyncio.wait_for(self.socket.read_message(), 30)
            if text is None:
                raise RuntimeError("the browser closed the page")
            message = json.loads(text)
            if "method" in message:
                self._note(message["method"], message["params"])
            if wanted(message):
                if "error" in message:
                    raise RuntimeError(str(message["error"]))
                return dict(message.get("result", message))

    async def show(
        self, address: str, width: int = 1200, height: int = 900, *, dark: bool = False, media: str = ""
    ) -> None:
        self.loaded = False
        size = {"width": width, "height": height, "mobile": width < 600}
        await self.call("Emulation.setDeviceMetricsOverride", **size, deviceScaleFactor=1)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        await self.call("Emulation.setEmulatedMedia", media=media, features=[scheme])
        await self.call("Page.navigate", url=address)
        while not self.loaded:
            await self._read(lambda message: "method" in message)

    async def fits(self, width: int) -> bool:
        return bool(await self.ask(f"document.documentElement.scrollWidth <= {width}"))

    async def ask(self, expression: str, *, wait: bool = False) -> Any:
        how = {"returnByValue": True, "awaitPromise": wait}
        answer = await self.call("Runtime.evaluate", expression=expression, **how)
        return answer["result"].get("value")

    async def violations(self) -> str:
        """Return what axe-core finds on the page as it is; once it is shown that it sees a fault."""
        # the protocol runs scripts in spite of the page's policy
        await self.ask(AXE.read_text(encoding="utf-8"))
        found = str(await self.ask(AXE_RUN, wait=True))
        if not self.judge_is_awake:
            await self.ask("document.documentElement.removeAttribute('lang')")
            self.judge_is_awake = "html-has-lang" in await self.ask(AXE_RUN, wait=True)
            assert self.judge_is_awake
        return found

    async def picture(self) -> bytes:
        answer = await self.call("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        return base64.b64decode(answer["data"])


async def _visited(browser: str, visit: Callable[[Page], Coroutine[Any, Any, T]]) -> T:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [browser, *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port = await _port(Path(profile), process)
            reply = await AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/json/list")
            target = next(entry for entry in json.loads(reply.body) if entry["type"] == "page")
            page = Page(await websocket_connect(target["webSocketDebuggerUrl"], max_message_size=2**28))
            for domain in ("Page", "Network", "Log", "Runtime"):
                await page.call(f"{domain}.enable")
            found = await visit(page)
            page.socket.close()
            return found
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            process.kill()
            process.wait(10)


async def _port(profile: Path, process: subprocess.Popen[bytes]) -> int:
    end = time.monotonic() + _START_SECONDS
    place = profile / "DevToolsActivePort"
    while time.monotonic() < end and process.poll() is None:
        with contextlib.suppress(OSError, ValueError, IndexError):
            return int(place.read_text().splitlines()[0])
        await asyncio.sleep(0.1)
    raise RuntimeError("the browser does not start")


def in_browser(browser: str, visit: Callable[[Page], Coroutine[Any, Any, T]]) -> T:
    """Open a browser, hand a page to ``visit``, close the browser."""
    return asyncio.run(_visited(browser, visit))
