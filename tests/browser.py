"""A page in a headless Chromium, driven through its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any

from typing_extensions import Self
from websockets.sync.client import connect

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
"""Nothing but the page is loaded."""
SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""WebGL on the processor."""


class Page:
    """One page; leave the ``with`` block to close the browser."""

    def __init__(self, url: str, profile: Path, width: int = 1400, height: int = 900) -> None:
        assert CHROMIUM is not None
        words = [*QUIET, *SOFTWARE_GL, f"--user-data-dir={profile}", f"--window-size={width},{height}"]
        command = [CHROMIUM, *words, "--remote-debugging-port=0", "about:blank"]
        self._browser = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        told = profile / "DevToolsActivePort"
        while not (told.exists() and (lines := told.read_text().splitlines())):
            assert self._browser.poll() is None, "Chromium has ended"
            time.sleep(0.05)
        address = f"127.0.0.1:{lines[0]}"
        with urllib.request.urlopen(f"http://{address}/json/list") as answer:
            tabs = json.load(answer)
        tab = next(tab for tab in tabs if tab["type"] == "page")
        self._socket = connect(tab["webSocketDebuggerUrl"], max_size=None)
        self._numbers = itertools.count(1)
        self.call("Page.enable")
        self.call("Page.navigate", url=url)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._socket.close()
        self._browser.terminate()
        self._browser.wait()

    def call(self, method: str, **arguments: Any) -> dict[str, Any]:
        """One method of the DevTools protocol."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": arguments}))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]

    def js(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def wait_for(self, expression: str) -> Any:
        """Wait until a JavaScript expression is true, for as long as the test may take."""
        while not (value := self.js(expression)):
            time.sleep(0.05)
        return value

    def click(self, words: str, kind: str = "button") -> None:
        """Click the first element of a kind with these words."""
        here = f"[...document.querySelectorAll({kind!r})].find(e => e.innerText.includes({words!r}))"
        self.wait_for(f"!!{here}")
        self.js(f"{here}.click()")

    def press(self, key: str) -> None:
        """Press and release a letter's key."""
        for kind in ("keyDown", "keyUp"):
            code = {"key": key, "code": f"Key{key.upper()}", "windowsVirtualKeyCode": ord(key.upper())}
            self.call("Input.dispatchKeyEvent", type=kind, **code)

    def save(self, path: Path) -> None:
        """Write a picture of what is seen, PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))
