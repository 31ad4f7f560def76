"""A headless Chromium driven over its DevTools protocol, with nothing but Python's standard library."""
import base64
import json
import os
import pathlib
import shutil
import socket
import struct
import subprocess
import tempfile
import time
import urllib.parse

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# WebGL2 without a graphics card; a container's /dev/shm is often too small for the browser.
FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--ignore-gpu-blocklist", "--hide-scrollbars", "--no-first-run", "--disable-background-networking", "--disable-extensions",
         "--disable-component-update", "--disable-sync", "--mute-audio", "--remote-debugging-port=0")


def find():
    """Path of a Chromium, or None."""
    named = os.environ.get("CHROMIUM")
    return named or next((path for path in map(shutil.which, NAMES) if path), None)


class WebSocket:
    """A client of RFC 6455: text and binary messages, no extensions."""

    def __init__(self, url, headers=(), seconds=30):
        parts = urllib.parse.urlsplit(url)
        self.socket = socket.create_connection((parts.hostname, parts.port or 80), timeout=seconds)
        self.buffer = b""
        key = base64.b64encode(os.urandom(16)).decode()
        path = (parts.path or "/") + ("?" + parts.query if parts.query else "")
        lines = [f"GET {path} HTTP/1.1", f"Host: {parts.netloc}", "Upgrade: websocket", "Connection: Upgrade",
                 f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", *headers, "", ""]
        self.socket.sendall("\r\n".join(lines).encode())
        head = self._until(b"\r\n\r\n").decode("latin-1")
        if " 101 " not in head.splitlines()[0]:
            raise ConnectionError(head.splitlines()[0])

    def _until(self, mark):
        while mark not in self.buffer:
            self._more()
        found, self.buffer = self.buffer.split(mark, 1)
        return found

    def _more(self):
        data = self.socket.recv(1 << 16)
        if not data:
            raise ConnectionError("the other side closed the connection")
        self.buffer += data

    def _exactly(self, count):
        while len(self.buffer) < count:
            self._more()
        found, self.buffer = self.buffer[:count], self.buffer[count:]
        return found

    def send(self, data, opcode=1):
        data = data.encode() if isinstance(data, str) else data
        size = len(data)
        length = bytes([0x80 | size]) if size < 126 else struct.pack(">BH", 0xFE, size) if size < 1 << 16 else struct.pack(">BQ", 0xFF, size)
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[k % 4] for k, byte in enumerate(data))
        self.socket.sendall(bytes([0x80 | opcode]) + length + mask + masked)

    def receive(self):
        """(opcode, payload) of the next whole message; 8 is a close, its payload code and reason."""
        kind, payload = 0, b""
        while True:
            first, second = self._exactly(2)
            size = second & 0x7F
            if size == 126:
                (size,) = struct.unpack(">H", self._exactly(2))
            elif size == 127:
                (size,) = struct.unpack(">Q", self._exactly(8))
            data = self._exactly(size)
            opcode = first & 0x0F
            if opcode == 9:
                self.send(data, 10)
                continue
            if opcode == 8:
                return 8, data
            if opcode == 10:
                continue
            kind, payload = kind or opcode, payload + data
            if first & 0x80:
                return kind, payload

    def close(self):
        self.socket.close()


class Browser:
    """One Chromium with one page."""

    def __init__(self, program, width=1440, height=900):
        try:
            self._start(program, width, height)
        except TimeoutError as error:  # now and then a browser ends or hangs as it starts
            print(f"the browser is started again: {error}; {error.__notes__}", flush=True)
            self._start(program, width, height)

    def _start(self, program, width, height):
        self.folder = tempfile.TemporaryDirectory(prefix="softtwin-browser-", ignore_cleanup_errors=True)
        log = pathlib.Path(self.folder.name) / "log"
        self.log = open(log, "wb")
        self.process = subprocess.Popen([program, *FLAGS, f"--user-data-dir={self.folder.name}/profile", f"--window-size={width},{height}", "about:blank"],
                                        stdout=self.log, stderr=self.log)
        try:
            self.socket = WebSocket(self._target(), seconds=180)  # a starved machine draws slowly
            self.count, self.events = 0, []
            for domain in ("Page", "Runtime", "Log"):
                self.call(f"{domain}.enable")
            self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        except BaseException as error:
            error.add_note(f"the browser said: {log.read_text(errors='replace')[-2000:]}")
            self.close()
            raise

    def _target(self):
        port_file = pathlib.Path(self.folder.name) / "profile" / "DevToolsActivePort"
        wait(lambda: port_file.exists() and port_file.read_text().strip(), "the browser's DevTools port", 60, lambda: self.process.poll() is not None)
        port = port_file.read_text().split()[0]
        import urllib.request
        def page():
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                return next((t["webSocketDebuggerUrl"] for t in json.load(answer) if t["type"] == "page"), None)
        return wait(page, "a page", 30)

    def call(self, method, **parameters):
        self.count += 1
        number = self.count
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.receive()[1])
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]
            self.events.append(message)

    def run(self, script):
        """Value of a JavaScript expression; promises are awaited."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description") or details["text"])
        return answer["result"].get("value")

    def open(self, url):
        self.call("Page.navigate", url=url)

    def screenshot(self):
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def complaints(self):
        """Errors in the browser's console."""
        self.run("0")
        said = [e["params"]["exceptionDetails"].get("exception", {}).get("description", "exception") for e in self.events if e.get("method") == "Runtime.exceptionThrown"]
        said += [f'{e["params"]["entry"]["text"]} {e["params"]["entry"].get("url", "")}' for e in self.events
                 if e.get("method") == "Log.entryAdded" and e["params"]["entry"]["level"] == "error"]
        return said

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.log.close()
        self.folder.cleanup()


def wait(condition, what, seconds=20, broken=lambda: False):
    """Polls until the condition is truthy and returns it; a deadline turns into an error that says what was awaited."""
    end = time.monotonic() + seconds
    while True:
        found = condition()
        if found:
            return found
        if broken() or time.monotonic() > end:
            raise TimeoutError(f"waited {seconds} s for {what}")
        time.sleep(0.05)
