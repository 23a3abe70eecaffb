"""A headless Chromium, controlled over its debugging pipe: no library, no port, no network."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
TIMEOUT = 60.0  # [s]
_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)


def chromium() -> str | None:
    """Path of an installed Chromium, or None."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Browser:
    """One page, with its errors and its network requests."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read, self._number = write, read, 0
        self._pending = b""
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def open(self, path: Path, width: int, height: int = 900) -> None:
        """Open a file in a window of this width [px]."""
        self.resize(width, height)
        self.requests.clear()
        self.errors.clear()
        self._loaded = False
        self._call("Page.navigate", url=path.as_uri())
        self._until(lambda: self._loaded, "the page to load")
        self.settle()

    def resize(self, width: int, height: int = 900) -> None:
        """Change the size of the window [px]."""
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def settle(self, seconds: float = 0.5) -> None:
        """Wait while the page works."""
        self.run(f"new Promise(done => setTimeout(done, {int(1000 * seconds)}))")

    def run(self, script: str) -> Any:
        """Value of an expression in the page; waits for a promise."""
        answer = self._call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def screenshot(self, selector: str | None = None) -> bytes:
        """PNG of an element, or of the whole page."""
        expression = (
            f"document.querySelector({json.dumps(selector)})"
            if selector
            else "document.documentElement"
        )
        box = self.run(
            f"(() => {{ const b = {expression}.getBoundingClientRect();"
            " return [b.x + scrollX, b.y + scrollY, b.width, b.height]; })()"
        )
        clip = dict(zip(("x", "y", "width", "height"), box, strict=True), scale=1)
        data = self._call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)["data"]
        return base64.b64decode(data)

    def pdf(self) -> bytes:
        """The page as PDF."""
        data = self._call("Page.printToPDF", preferCSSPageSize=True, printBackground=False)
        return base64.b64decode(data["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        number = self._number
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if hasattr(self, "_session"):
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        answer: dict[str, Any] = {}

        def answered() -> bool:
            return bool(answer)

        self._until(answered, method, number, answer)
        assert "error" not in answer, f"{method}: {answer['error']}"
        result: dict[str, Any] = answer["result"]
        return result

    def _until(self, done: Any, what: str, number: int = -1, answer: Any = None) -> None:
        limit = time.monotonic() + TIMEOUT
        while not done():
            left = limit - time.monotonic()
            assert left > 0, f"Chromium: waited {TIMEOUT:.0f} s for {what}"
            for message in self._messages(left):
                if message.get("id") == number:
                    answer.update(message)
                else:
                    self._note(message)

    def _messages(self, wait: float) -> Iterator[dict[str, Any]]:
        if not select.select([self._read], [], [], wait)[0]:
            return
        piece = os.read(self._read, 1 << 20)
        assert piece, "Chromium ended"
        *whole, self._pending = (self._pending + piece).split(b"\0")
        for message in whole:
            yield json.loads(message)

    def _note(self, message: dict[str, Any]) -> None:
        parameters = message.get("params", {})
        match message.get("method"):
            case "Page.loadEventFired":
                self._loaded = True
            case "Network.requestWillBeSent":
                self.requests.append(parameters["request"]["url"])
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(parameters["exceptionDetails"]))
            case "Log.entryAdded" if parameters["entry"]["level"] in ("error", "warning"):
                self.errors.append(parameters["entry"]["text"])
            case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "warning"):
                self.errors.append(json.dumps(parameters["args"]))


def _pipe() -> tuple[int, int]:
    """Ends of a pipe with descriptors other than 3 and 4."""
    ends = os.pipe()
    high = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in ends]
    for end in ends:
        os.close(end)
    return high[0], high[1]


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser for the duration of a test, with a temporary profile."""
    program = chromium()
    assert program is not None
    to_child, from_here = _pipe()
    to_here, from_child = _pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        # The child expects the pipe's ends as descriptors 3 and 4.
        script = f'exec "$0" "$@" 3<&{to_child} 4>&{from_child}'
        process = subprocess.Popen(
            ["bash", "-c", script, program, *_OPTIONS, f"--user-data-dir={profile}"],
            pass_fds=(to_child, from_child),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_child)
        os.close(from_child)
        try:
            yield Browser(from_here, to_here)
        finally:
            os.close(from_here)
            os.close(to_here)
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
