"""A headless Chromium, driven through a pipe (Chrome DevTools Protocol, messages that end in NUL)."""

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time


def find_chromium():
    return shutil.which("chromium") or shutil.which("chromium-browser")


class Page:
    """One browser with one page. Use as a context manager."""

    def __init__(self, width=1440, height=860, scale=1, dark=True):
        self.folder = tempfile.mkdtemp(prefix="nilio-chromium-")
        to_browser, self.out = os.pipe()
        self.into, from_browser = os.pipe()
        self.next_id = 0
        self.rest = b""
        self.errors = []
        arguments = [find_chromium(), "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
                     "--hide-scrollbars", "--no-first-run", "--disable-extensions", "--disable-background-networking",
                     "--disable-component-update", "--remote-debugging-pipe", f"--user-data-dir={self.folder}", "about:blank"]

        def descriptors():
            # The browser reads from 3 and writes to 4.
            low, high = os.dup(to_browser), os.dup(from_browser)
            read, write = (os.dup(low), os.dup(high))
            while read <= 4:
                read = os.dup(read)
            while write <= 4:
                write = os.dup(write)
            os.dup2(read, 3)
            os.dup2(write, 4)
            os.set_inheritable(3, True)
            os.set_inheritable(4, True)

        self.process = subprocess.Popen(arguments, preexec_fn=descriptors, close_fds=False, stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        os.close(to_browser)
        os.close(from_browser)
        os.set_blocking(self.into, False)
        target = self.call("Target.createTarget", {"url": "about:blank"})["targetId"]
        self.session = self.call("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        for domain in ("Page", "Runtime", "Performance"):
            self.call(f"{domain}.enable")
        self.resize(width, height, scale)
        self.theme(dark)

    session = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.into)
        os.close(self.out)
        shutil.rmtree(self.folder, ignore_errors=True)

    def call(self, method, parameters=None, timeout=60):
        self.next_id += 1
        message = {"id": self.next_id, "method": method, "params": parameters or {}}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            answer = self._read()
            if answer is None:
                time.sleep(0.005)
                continue
            if answer.get("method") == "Runtime.exceptionThrown":
                details = answer["params"]["exceptionDetails"]
                self.errors.append(details.get("exception", {}).get("description", details["text"]))
            if answer.get("id") == self.next_id:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
        raise TimeoutError(f"{method}: no answer from Chromium within {timeout} s")

    def _read(self):
        while b"\0" not in self.rest:
            try:
                part = os.read(self.into, 1 << 20)
            except BlockingIOError:
                return None
            if not part:
                raise RuntimeError("Chromium has ended")
            self.rest += part
        line, self.rest = self.rest.split(b"\0", 1)
        return json.loads(line)

    def resize(self, width, height, scale=1):
        self.call("Emulation.setDeviceMetricsOverride",
                  {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": False})

    def theme(self, dark):
        self.call("Emulation.setEmulatedMedia",
                  {"features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]})

    def open(self, url):
        self.call("Page.navigate", {"url": url})

    def before(self, script):
        """Runs the script at the start of every page opened from now on."""
        self.call("Page.addScriptToEvaluateOnNewDocument", {"source": script})

    def run(self, expression):
        """Value of a JavaScript expression; promises are waited for."""
        result = self.call("Runtime.evaluate", {"expression": expression, "returnByValue": True, "awaitPromise": True})
        if "exceptionDetails" in result:
            raise RuntimeError(result["exceptionDetails"].get("exception", {}).get("description", "exception"))
        return result["result"].get("value")

    def wait(self, expression, timeout=30):
        """Waits until the expression is true; the seconds that it took."""
        begin = time.monotonic()
        while time.monotonic() - begin < timeout:
            if self.run(f"Boolean({expression})"):
                return time.monotonic() - begin
            time.sleep(0.05)
        raise TimeoutError(f"not true within {timeout} s: {expression}")

    def key(self, text):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", {"type": kind, "key": text, "text": text if kind == "keyDown" else ""})

    def screenshot(self, path):
        data = self.call("Page.captureScreenshot", {"format": "png"})["data"]
        with open(path, "wb") as file:
            file.write(base64.b64decode(data))

    def heap_bytes(self):
        """Used heap after a collection, and the number of nodes."""
        self.call("HeapProfiler.collectGarbage")
        metrics = {m["name"]: m["value"] for m in self.call("Performance.getMetrics")["metrics"]}
        return metrics["JSHeapUsedSize"], metrics["Nodes"]
