"""Headless Chromium, controlled over a pipe (DevTools protocol), for tests of pages."""

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-pipe",
)


class Browser:
    """A page in a new Chromium, `width` px wide.

    complaints: all that the console said, and what failed to load.
    """

    def __init__(self, width: int, height: int = 800) -> None:
        assert CHROMIUM
        self._home = tempfile.mkdtemp(prefix="pilsim-chromium-")
        there, self._write = os.pipe()
        self._read, back = os.pipe()
        # The browser reads file 3 and writes file 4.
        command = f'exec "$0" "$@" 3<&{there} 4>&{back}'
        arguments = ["bash", "-c", command, CHROMIUM, *FLAGS, f"--user-data-dir={self._home}", "about:blank"]
        silent = subprocess.DEVNULL
        self._process = subprocess.Popen(arguments, pass_fds=(there, back), stdout=silent, stderr=silent)
        os.close(there)
        os.close(back)
        self._buffer, self._count, self._session = b"", 0, ""
        self.complaints: list[str] = []
        pages = self.call("Target.getTargets")["targetInfos"]
        target = next(page["targetId"] for page in pages if page["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)
        # Processes that Chromium started may write into the folder for a moment after it has ended.
        deadline = time.monotonic() + 5
        while os.path.exists(self._home) and time.monotonic() < deadline:
            shutil.rmtree(self._home, ignore_errors=True)
            time.sleep(0.05)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Ask for something and wait for the answer."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer["error"]
                return dict(answer["result"])

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            data = os.read(self._read, 1 << 20)
            assert data, "Chromium has gone"
            self._buffer += data
        one, _, self._buffer = self._buffer.partition(b"\0")
        event: dict[str, Any] = json.loads(one)
        if event.get("method") in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded", "Network.loadingFailed"):
            self.complaints.append(f"{event['method']}: {event['params']}")
        self.last = event.get("method")
        return event

    def open(self, path: Path) -> None:
        """Load a file and wait until all of it is there."""
        self.call("Page.navigate", url=path.resolve().as_uri())
        while self.evaluate("document.readyState") != "complete":
            self._next()

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page; promises are waited for."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def picture(self, path: Path, whole: bool = True) -> None:
        """A PNG of the page, of all its length or of what is in view."""
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))
