"""A headless Chromium over its DevTools protocol, noting whatever a page complains of."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

_LOCAL = ("file:", "data:", "blob:")
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--remote-debugging-port=0",
)


class Page:
    """One page.

    Attributes
    ----------
    errors : what went to the console as an error, or was thrown.
    asked : addresses outside of the file that were asked for.
    """

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._number = 0
        self.errors: list[str] = []
        self.asked: list[str] = []
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """Answer of a DevTools command."""
        self._number += 1
        command = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(command))
        while True:
            received = json.loads(self._socket.recv())
            if received.get("id") == self._number:
                assert "error" not in received, received
                return received["result"]
            self._note(received)

    def ask(self, expression: str) -> Any:
        """Value of a JavaScript expression; promises are awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def open(
        self, path: Path, *, width: int = 1280, scheme: str = "light", ready: str = "yes"
    ) -> None:
        """Open a file and wait until its charts are drawn, or have failed: "undrawn"."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )
        self.call("Page.navigate", url=path.absolute().as_uri())
        waiting = """new Promise((done, late) => {
            const end = Date.now() + 40000;
            const look = () => document.documentElement?.dataset.ready
                ? done(document.documentElement.dataset.ready)
                : Date.now() > end ? late(new Error("not ready")) : setTimeout(look, 50);
            look(); })"""
        assert self.ask(waiting) == ready

    def _note(self, received: dict[str, Any]) -> None:
        parameters = received.get("params", {})
        match received.get("method"):
            case "Runtime.consoleAPICalled" if parameters["type"] in {"error", "assert"}:
                self.errors.append(json.dumps(parameters["args"]))
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(parameters["exceptionDetails"]))
            case "Log.entryAdded" if parameters["entry"]["level"] == "error":
                self.errors.append(parameters["entry"]["text"])
            case "Network.requestWillBeSent":
                url = parameters["request"]["url"]
                if not url.startswith(_LOCAL):
                    self.asked.append(url)


@contextlib.contextmanager
def browser(profile: Path, *options: str) -> Iterator[Page]:
    """A page in a browser of its own."""
    assert CHROMIUM is not None
    command = [CHROMIUM, *_OPTIONS, *options, f"--user-data-dir={profile}", "about:blank"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **silent) as process:  # noqa: S603 - the browser found above
        try:
            address, patient = _page_address(profile, process), {"open_timeout": None}
            with connect(address, max_size=None, ping_interval=None, **patient) as socket:
                yield Page(socket)
        finally:
            process.terminate()


def _page_address(profile: Path, process: subprocess.Popen[bytes]) -> str:
    """The DevTools address of the first page, once the browser listens."""
    received = profile / "DevToolsActivePort"
    while True:
        if received.exists() and received.read_text().strip():
            port = received.read_text().split()[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
                pages = [p for p in json.load(answer) if p["type"] == "page"]
            if pages:
                return str(pages[0]["webSocketDebuggerUrl"])
        assert process.poll() is None, "the browser ended"
        time.sleep(0.05)
