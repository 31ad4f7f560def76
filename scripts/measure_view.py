"""Frames a second of `softtwin view` and the twin's latency with and without viewers. See measure_view.sh."""
import argparse
import json
import os
import pathlib
import threading
import time

from browser import WebSocket
from test_view import MODEL, Stage


class Viewer(threading.Thread):
    """A page without a picture: takes a frame, draws for so long, asks for the next."""

    def __init__(self, url, drawing_s=0.0):
        super().__init__(daemon=True)
        self.socket, self.drawing_s = WebSocket(url.replace("http", "ws") + "ws"), drawing_s
        self.frames, self.bytes, self.seqs = 0, 0, []
        self.start()

    def run(self):
        self.socket.send('{"type":"ready"}')
        while True:
            try:
                kind, data = self.socket.receive()
            except (OSError, ConnectionError):
                return
            header = json.loads(data[4:4 + int.from_bytes(data[:4], "little")]) if kind == 2 else {}
            if header.get("kind") == "frame" and header["count"]:
                self.frames, self.bytes = self.frames + 1, len(data)
                self.seqs.append(header["seq"])
                time.sleep(self.drawing_s)
                self.socket.send('{"type":"ready"}')


def measure(options, name, delays):
    stage = Stage(options.programs)
    try:
        stage.twin()
        viewers = []
        if delays is not None:
            _, url = stage.view("--model", MODEL)
            viewers = [Viewer(url, delay) for delay in delays]
        time.sleep(options.seconds)
        found = stage.run("softtwin", "echo", "softtwin/finger/health", "--once", "--json")
        health = json.loads(found.stdout)["sample"]
        print(f"{name:<34} latency p50 {health['latency_p50_ns'] / 1e3:7.0f}  p99 {health['latency_p99_ns'] / 1e3:7.0f}  max "
              f"{health['latency_max_ns'] / 1e3:7.0f} us  {health['received']} readings, {health['missed']} missed", flush=True)
        for viewer in viewers:
            skipped = viewer.seqs[-1] - viewer.seqs[0] + 1 - len(viewer.seqs)
            print(f"{'':<8}viewer: {viewer.frames / options.seconds:5.1f} frames/s of {viewer.bytes / 1e3:.0f} kB, {skipped} published fields skipped")
    finally:
        stage.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", required=True, help="folder of softtwin and softtwind")
    parser.add_argument("--seconds", type=float, default=10.0, help="time of each measurement")
    options = parser.parse_args()
    os.chdir(pathlib.Path(__file__).resolve().parent.parent)
    print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    measure(options, "nobody looks", None)
    measure(options, "a viewer without pages", [])
    measure(options, "three pages", [0.0, 0.0, 0.0])
    measure(options, "one page that draws for 200 ms", [0.2])


if __name__ == "__main__":
    main()
