// The connection: one websocket, opened again when it breaks.
//
// Text frames are JSON. Binary frames are: u32 length of a JSON header, the header, zeros up to a multiple of four, then
// 32-bit numbers. The server sends the next frame only after `ready()`, so a slow page skips frames and queues none.

const RETRY_MS = [250, 500, 1000, 2000];

export class Link {
  constructor({ onMessage, onFrame, onUp, onDown }) {
    Object.assign(this, { onMessage, onFrame, onUp, onDown, attempts: 0, requested_ms: 0, answered: true });
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(`${scheme}//${location.host}/ws${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { Object.assign(this, { attempts: 0, answered: true }); this.onUp(); this.ready(); };
    this.socket.onmessage = (event) => {
      if (typeof event.data === "string") this.onMessage(JSON.parse(event.data));
      else { this.answered = true; this.onFrame(...unpack(event.data)); }
    };
    this.socket.onclose = (event) => {
      this.onDown(event.reason);
      setTimeout(() => this.open(), RETRY_MS[Math.min(this.attempts++, RETRY_MS.length - 1)]);
    };
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  // Requests what is new. Data are old when none come after a request, not when drawing is slow.
  ready() {
    if (this.answered) Object.assign(this, { requested_ms: performance.now(), answered: false });
    this.send({ type: "ready" });
  }
}

export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return [header, buffer, Math.ceil((4 + length) / 4) * 4];
}
