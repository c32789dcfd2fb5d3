"""Drives a headless Chromium through its DevTools protocol, over a pair of pipes."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.runtime.arrays import Array

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 60.0  # seconds

# Graphics in software, the same on every machine, and no traffic of the browser's own.
OPTIONS = (
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--window-size=1000,700", "--disable-background-networking", "--no-first-run",
    "--remote-debugging-pipe",
)  # fmt: skip


class Browser:
    """A browser with one page."""

    def __init__(self, profile: Path) -> None:
        program = next(filter(None, map(shutil.which, NAMES)), None)
        if program is None:
            pytest.skip(f"no Chromium is installed ({', '.join(NAMES)})")
        read, self._to = os.pipe()
        self._from, write = os.pipe()
        # The browser reads commands from descriptor 3 and answers on 4.
        command = 'exec 3<&"$1" 4>&"$2"; shift 2; exec "$@"'
        numbers = [str(read), str(write)]
        self._process = subprocess.Popen(
            [
                "bash",
                "-c",
                command,
                "bash",
                *numbers,
                program,
                *OPTIONS,
                f"--user-data-dir={profile}",
            ],
            pass_fds=(read, write),
            start_new_session=True,
            stderr=subprocess.DEVNULL,
        )
        os.close(read)
        os.close(write)
        self.pid = self._process.pid
        self._number = 0
        self._session: str | None = None
        self._received = b""
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self("Target.createTarget", url="about:blank")["targetId"]
        self._session = self("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self(f"{domain}.enable")

    def __call__(self, method: str, **params: Any) -> Any:
        """Send a command and return what it answers."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._received:
            chunk = os.read(self._from, 2**20)
            assert chunk, "the browser has ended"
            self._received += chunk
        message, _, self._received = self._received.partition(b"\0")
        answer: dict[str, Any] = json.loads(message)
        return answer

    def _note(self, event: dict[str, Any]) -> None:
        method, params = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning"):
            self.errors.append(str(params["args"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            # A browser without a graphics card tells that reading pixels is slow there.
            if "GPU stall due to ReadPixels" not in params["entry"]["text"]:
                self.errors.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])

    def open(self, page: Path, fragment: str = "") -> None:
        """Open a page, at what stands behind its #, and wait until it says that it is ready."""
        # Of the same page, only the fragment would change.
        self("Page.navigate", url="about:blank")
        self("Page.navigate", url=page.resolve().as_uri() + fragment)
        self.wait("document.documentElement?.dataset.ready === 'yes'")
        self.settle()

    def wait(self, condition: str) -> None:
        """Wait until an expression of JavaScript becomes true."""
        end = time.monotonic() + PATIENCE
        while not self.evaluate(condition):
            assert time.monotonic() < end, (condition, self.errors)
            time.sleep(0.05)

    def settle(self) -> None:
        """Wait until what was done is drawn, and the view is at rest."""
        frame = "await new Promise((done) => requestAnimationFrame(done));"
        self.evaluate(f"(async () => {{ {2 * frame} return true; }})()")
        self.wait("document.documentElement.dataset.view === 'still'")

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression of JavaScript."""
        answer = self(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def text(self, selector: str) -> str:
        """Return the text of an element."""
        return str(self.evaluate(f"document.querySelector({selector!r}).textContent"))

    def click(self, selector: str) -> None:
        """Click an element."""
        self.evaluate(f"document.querySelector({selector!r}).click()")
        self.settle()

    def key(self, key: str) -> None:
        """Press and release a key."""
        for kind in ("keyDown", "keyUp"):
            self("Input.dispatchKeyEvent", type=kind, key=key)
        self.settle()

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Send an event of the mouse: mouseMoved, mousePressed, mouseReleased, mouseWheel."""
        self("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)
        self.settle()

    def picture(self) -> Array:
        """Return what is to be seen, uint8 (rows, columns, 3)."""
        from PIL import Image

        png = base64.b64decode(self("Page.captureScreenshot")["data"])
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))

    def close(self) -> None:
        """End the browser."""
        self._session = None
        self("Browser.close")
        self._process.wait(PATIENCE)
        os.close(self._to)
        os.close(self._from)


@contextmanager
def telephone(browser: Browser) -> Iterator[None]:
    """Let pages be as narrow as on a telephone, 420 by 800 pixels, within the block."""
    size = {"width": 420, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    browser("Emulation.setDeviceMetricsOverride", **size)
    try:
        yield
    finally:
        browser("Emulation.clearDeviceMetricsOverride")
