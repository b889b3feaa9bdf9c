"""Chromium without a window, driven by its DevTools protocol through the WebSocket client that the tests have anyway."""

from __future__ import annotations

import base64
import json
import subprocess
import time
import urllib.request
from pathlib import Path

from websockets.sync.client import connect

WAIT_S = 30  # until the browser is given up: a first start on a busy machine


class Browser:
    """One page; a context manager."""

    def __init__(self, program: str, folder: Path, url: str):
        self.folder, self.url, self.errors, self._number = folder / "browser", url, [], 0
        self._command = [program, "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
        self._command += ["--window-size=1300,800", f"--user-data-dir={self.folder}", "about:blank"]

    def __enter__(self) -> Browser:
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(self._command, stdout=quiet, stderr=quiet)
        told, end = self.folder / "DevToolsActivePort", time.monotonic() + WAIT_S
        while not told.is_file() or "\n" not in told.read_text():
            assert time.monotonic() < end, "the browser does not start"
            time.sleep(0.05)
        port = told.read_text().splitlines()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            page = next(target for target in json.load(answer) if target["type"] == "page")
        self._closing = connect(page["webSocketDebuggerUrl"], max_size=None)
        self._client = self._closing.__enter__()
        self._ask("Runtime.enable")
        self._ask("Page.navigate", url=self.url)
        return self

    def __exit__(self, *_) -> None:
        self._closing.__exit__(None, None, None)
        self._process.terminate()
        self._process.wait(timeout=WAIT_S)

    def _ask(self, method: str, **parameters) -> dict:
        self._number += 1
        self._client.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._client.recv(timeout=WAIT_S))
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(answer["params"]["exceptionDetails"]["text"])
            if answer.get("id") == self._number:
                return answer["result"]

    def value(self, expression: str):
        """Return the value of a JavaScript expression."""
        return self._ask("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def until(self, expression: str, expected) -> None:
        """Wait until an expression has a value."""
        end = time.monotonic() + WAIT_S
        while (found := self.value(expression)) != expected:
            assert time.monotonic() < end, f"{expression} is {found!r}, not {expected!r}"
            time.sleep(0.05)

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"]))
