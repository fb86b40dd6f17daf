"""A real headless Chromium, driven over its debugging pipe: what a reader's browser does."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

BINARY = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which(
    "google-chrome"
)  # fmt: skip
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu"]
FLAGS += ["--no-first-run", "--disable-extensions", "--disable-background-networking"]


class Page:
    """One page of one browser. Use as a context manager."""

    def __init__(self, folder: Path, patience: float = 600.0):
        assert BINARY is not None
        self.patience, self.count, self.events = patience, 0, list[dict[str, Any]]()
        self.rest = b""
        here, there = os.pipe(), os.pipe()  # to the browser, and back

        def pipes() -> None:  # the browser reads from 3 and writes to 4
            os.dup2(here[0], 3)
            os.dup2(there[1], 4)

        command = [BINARY, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={folder}"]
        # Below 10 the pipe's own ends would be overwritten by 3 and 4.
        here, there = ([_high(end) for end in pair] for pair in (here, there))
        self.process = subprocess.Popen(
            command, preexec_fn=pipes, close_fds=False,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(here[0])
        os.close(there[1])
        self.to, self.back = here[1], there[0]
        self.session = ""
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log", "Performance"):
            self.send(f"{domain}.enable")

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        self.process.wait(timeout=60)
        os.close(self.to)
        os.close(self.back)

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result; events meanwhile are kept."""
        self.count += 1
        message: dict[str, Any] = {"id": self.count, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self.count:
                assert "error" not in answer, answer
                return answer["result"]

    def open(self, path: Path) -> float:
        """Load a file; the time [s] until it is loaded and shown. Figures may still be drawn."""
        self.events.clear()
        started = time.monotonic()
        self.send("Page.navigate", url=path.as_uri())
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            self._read()
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return time.monotonic() - started

    def drawn(self) -> None:
        """Open what is folded, and wait for every figure."""
        self.run(
            "new Promise(done => {"
            "document.querySelectorAll('details').forEach(d => d.open = true);"
            "const look = () => [...document.querySelectorAll('.canvas')].every("
            "c => c.querySelector('svg')) ? done() : setTimeout(look, 50); look(); })"
        )

    def run(self, code: str) -> Any:
        """The value of an expression in the page."""
        made = self.send("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in made, made
        return made["result"].get("value")

    def show(self, width: int, height: int, dark: bool) -> None:
        """As wide as that, in px; light or dark."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=width < 600,
        )  # fmt: skip
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[scheme])
        self.run("new Promise(done => setTimeout(done, 300))")

    def picture(self, path: Path, whole: bool = True) -> None:
        """A PNG of what is seen, or of the whole page."""
        made = self.send("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(made["data"]))

    def sheets(self) -> int:
        """How many sheets of A4 it prints on."""
        made = self.send("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        return base64.b64decode(made["data"]).count(b"/Type /Page\n")

    def requested(self) -> list[str]:
        """Addresses the page asked for since it was opened; pictures it made itself are none."""
        asked = [e for e in self.events if e["method"] == "Network.requestWillBeSent"]
        addresses = [e["params"]["request"]["url"] for e in asked]
        return [at for at in addresses if not at.startswith(("data:", "blob:"))]

    def complaints(self) -> list[str]:
        """Errors and warnings of the console, and exceptions nobody caught."""
        told = []
        for event in self.events:
            params = event["params"]
            if event["method"] == "Runtime.exceptionThrown":
                told.append(json.dumps(params["exceptionDetails"]))
            elif event["method"] == "Runtime.consoleAPICalled" and params["type"] != "log":
                told.append(json.dumps(params["args"]))
            elif event["method"] == "Log.entryAdded":
                told.append(params["entry"]["text"])
        return told

    def _read(self) -> dict[str, Any]:
        until = time.monotonic() + self.patience
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.back], [], [], max(until - time.monotonic(), 0))
            assert ready, f"the browser said nothing for {self.patience} s"
            part = os.read(self.back, 1 << 20)
            assert part, "the browser went away"
            self.rest += part
        line, _, self.rest = self.rest.partition(b"\0")
        message = json.loads(line)
        if "method" in message:
            self.events.append(message)
        return message


def _high(end: int) -> int:
    import fcntl

    high = fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10)
    os.close(end)
    return high
