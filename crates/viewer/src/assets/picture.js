// The scene with its numbers as a picture (PNG) or a film, without anything but the browser.

import { css } from "./scene.js";

const FRAMES_PER_S = 30;
const FORMATS = [["video/webm;codecs=vp9", "webm"], ["video/webm", "webm"], ["video/mp4", "mp4"]];
const BITS_PER_S = 8e6;

export class Recorder {
  // `describe()`: { title, numbers: [text], labels: [{ left, at, text }], scale } of what is shown.
  constructor(scene, describe, failed) {
    Object.assign(this, { scene, describe, failed, canvas: document.createElement("canvas"), film: null });
  }

  get filming() { return this.film !== null; }

  // Saves what the scene shows; it must just have been drawn.
  save() {
    this.compose();
    this.canvas.toBlob((blob) => download(blob, "png"), "image/png");
  }

  // Begins a film, or ends it and saves it.
  toggle() {
    if (this.film) { this.film.stop(); return; }
    const format = FORMATS.find(([type]) => window.MediaRecorder?.isTypeSupported(type));
    if (!format) { this.failed("This browser cannot record a canvas; a current Firefox, Chrome or Edge can"); return; }
    this.compose();
    const parts = [];
    this.film = new MediaRecorder(this.canvas.captureStream(FRAMES_PER_S), { mimeType: format[0], videoBitsPerSecond: BITS_PER_S });
    this.film.ondataavailable = ({ data }) => parts.push(data);
    this.film.onstop = () => { this.film = null; download(new Blob(parts, { type: format[0] }), format[1]); };
    this.film.start(1000);
  }

  // Called after each drawing of the scene.
  drawn() {
    if (this.film) this.compose();
  }

  // Scene, names, numbers and colour scale on one canvas. Its size stays while a film runs.
  compose() {
    const { canvas, scene } = this;
    const { title, numbers, labels, scale } = this.describe();
    if (!this.film) Object.assign(canvas, { width: scene.width + (scene.width & 1), height: scene.height + (scene.height & 1) });
    const draw = canvas.getContext("2d");
    const unit = canvas.width / scene.clientWidth; // one pixel of the browser
    draw.fillStyle = css("--sky");
    draw.fillRect(0, 0, canvas.width, canvas.height);
    draw.drawImage(scene, 0, 0, canvas.width, canvas.height);
    const text = (words, x, y, { size = 13, weight = 400, colour = "--ink", align = "left" } = {}) => {
      Object.assign(draw, { font: `${weight} ${size * unit}px system-ui, "DejaVu Sans", sans-serif`, fillStyle: css(colour), textAlign: align, textBaseline: "alphabetic" });
      draw.fillText(words, x * unit, y * unit);
    };
    text(title, 16, 28, { size: 16, weight: 650 });
    numbers.forEach((words, k) => text(words, 16, 50 + 19 * k));
    for (const { left, at, text: words } of labels) text(words, left, at[1] + 4, { weight: 650, colour: "--force" });
    this.drawScale(draw, scale, unit, text);
  }

  drawScale(draw, { element, title }, unit, text) {
    const [left, width, top] = [16, Math.min(300, this.scene.clientWidth - 32), this.scene.clientHeight - 40];
    text(title, left, top - 8);
    draw.drawImage(element.bar, left * unit, top * unit, width * unit, 12 * unit);
    for (const tick of element.ticks.children) {
      const share = parseFloat(tick.style.left) / 100;
      text(tick.textContent, left + share * width, top + 27, { size: 11, colour: "--faint", align: share < 0.03 ? "left" : share > 0.97 ? "right" : "center" });
    }
  }
}

function download(blob, ending) {
  const now = new Date();
  const stamp = new Date(now - 60000 * now.getTimezoneOffset()).toISOString().slice(0, 19).replaceAll(":", "-");
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: `softtwin-${stamp}.${ending}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}
