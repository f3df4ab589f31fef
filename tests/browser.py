"""A page in a headless Chromium, driven through its DevTools protocol."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from typing_extensions import Self

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
    """One page; leave the ``with`` block to close the browser.

    The browser listens at a pipe and ends when that is closed, however this process ends.
    """

    def __init__(self, url: str, profile: Path, width: int = 1400, height: int = 900) -> None:
        assert CHROMIUM is not None
        words = [*QUIET, *SOFTWARE_GL, f"--user-data-dir={profile}", f"--window-size={width},{height}"]
        (its_in, to_it), (from_it, its_out) = os.pipe(), os.pipe()
        # Chromium reads descriptor 3 and writes descriptor 4.
        self._browser = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{its_in} 4>&{its_out}', "bash", CHROMIUM, *words, "--remote-debugging-pipe"],
            stderr=subprocess.DEVNULL,
            pass_fds=(its_in, its_out),
            start_new_session=True,
        )
        os.close(its_in)
        os.close(its_out)
        self._to_it, self._from_it = os.fdopen(to_it, "wb", buffering=0), os.fdopen(from_it, "rb")
        self._numbers, self._told = itertools.count(1), b""
        self._session: dict[str, str] = {}
        try:
            target = self.call("Target.createTarget", url="about:blank")["targetId"]
            attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
            self._session = {"sessionId": attached["sessionId"]}
            self.call("Page.enable")
            self.call("Page.navigate", url=url)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the browser, with all its processes."""
        self._to_it.close()
        self._from_it.close()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._browser.pid, signal.SIGKILL)
        self._browser.wait()

    def call(self, method: str, **arguments: Any) -> dict[str, Any]:
        """One method of the DevTools protocol."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": arguments, **self._session}
        self._to_it.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._told:
            read = os.read(self._from_it.fileno(), 1 << 16)
            assert read, "Chromium has ended"
            self._told += read
        message, _, self._told = self._told.partition(b"\0")
        return json.loads(message)

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
