"""Screenshots of the viewer in five sizes, light and dark, in every mode, for visual review; the README's moving
picture; how many frames a browser draws. See scripts/check.sh."""
import io
import json
import pathlib
import subprocess

from browser import wait

MODEL = "models/pneunet/pneunet.twin"
SIZES = ((390, 844), (820, 1180), (1280, 720), (1440, 900), (1920, 1080))
THEMES = ("light", "dark")
# A synthetic trace with a load cell: it shows how the viewer displays a measured force.
CELL_SCENE = """name = "finger"
[[actuator]]
name = "finger"
model = "{root}/models/pneunet/pneunet.twin"
gap_mm = "measured"
[actuator.source]
kind = "replay"
trace = "{trace}"
[[actuator.output]]
nodes = "surface"
"""
# As sharp as it can be drawn: twice the pixels of the screen, whatever the time it takes.
SHARP = "softtwin.painter.software = false; softtwin.painter.sharpness = 2; softtwin.state.dirty = true"


# What does not fit: a page wider than the screen, numbers and charts longer than their column, a shape or a force beside the
# scene, a command broken over two lines.
CUT = """(() => {
  const [page, panel, stage] = [document.documentElement, document.getElementById("panel"), document.getElementById("stage").getBoundingClientRect()];
  const found = page.scrollWidth > innerWidth ? ["width"] : [];
  if (innerWidth >= 1000 && panel.scrollHeight > panel.clientHeight + 1) found.push(`the charts, by ${panel.scrollHeight - panel.clientHeight} pixels`);
  for (const code of document.querySelectorAll("code")) if (code.getClientRects().length > 1) found.push(code.textContent);
  const { camera, visible } = softtwin;
  const isCut = ([x, y]) => x < 0 || y < 0 || x > camera.canvas.clientWidth || y > camera.canvas.clientHeight;
  for (const body of visible()) if (body.some(1000).some((point) => isCut(camera.project(point) ?? [-1, -1]))) found.push(`${body.name} in the scene`);
  for (const mark of document.querySelectorAll(".mark")) {
    const box = mark.getBoundingClientRect();
    if (box.left < stage.left || box.right > stage.right || box.top < stage.top || box.bottom > stage.bottom) found.push(`${mark.textContent} in the scene`);
  }
  return found;
})()"""


def take(stage, program, folder, make_page, only=""):
    """All screenshots into a folder, with an index.html that shows them side by side."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for mode, begin in MODES.items():
        if only not in mode:
            continue
        processes, url, ready = begin(stage)
        page = make_page(program, url)
        try:
            ready(page)
            page.run(SHARP)
            for theme in THEMES:
                page.browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
                for width, height in SIZES:
                    names.append(f"{mode}-{width}x{height}-{theme}.png")
                    (folder / names[-1]).write_bytes(shot(page, width, height))
                    print(names[-1], flush=True)
            assert not page.browser.complaints(), page.browser.complaints()
        finally:
            page.browser.close()
        stage.end(*processes)
    figures = "".join(f'<figure><img src="{name}" width="460"><figcaption>{name}</figcaption></figure>' for name in names)
    (folder / "index.html").write_text(f"<!doctype html><style>body{{display:flex;flex-wrap:wrap;font:12px sans-serif}}</style>{figures}")


def shot(page, width, height):
    """One screenshot; a page that is longer than the screen is shown whole."""
    browser = page.browser
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 900)
    settle(page)
    cut = page.run(CUT)
    assert cut == [], f"cut off at {width} x {height}: {cut}"
    whole = page.run("document.documentElement.scrollHeight")
    if whole > height:
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=whole, deviceScaleFactor=1, mobile=True)
        page.run(f"document.getElementById('stage').style.height = 'clamp(300px, {0.4 * height}px, 620px)'")
        settle(page)
    data = browser.screenshot()
    page.run("document.getElementById('stage').style.height = ''")
    return data


def settle(page):
    page.run("new Promise((done) => setTimeout(() => { softtwin.state.dirty = true; requestAnimationFrame(() => requestAnimationFrame(done)); }, 250))")


def live(stage):
    twin, bridge = stage.twin()
    view, url = stage.view(MODEL)
    return (view, bridge, twin), url, in_contact


def in_contact(page):
    wait(lambda: page.run("(softtwin.chosen()?.history.minute.bins.length ?? 0) > 100"), "six seconds of readings", 60)
    wait(lambda: 0.05 < (page.shown("pressure_mpa") or 0) and (page.shown("contact_force_n") or 0) > 0, "contact", 60)


def cell(stage):
    folder = pathlib.Path(stage.folder.name)
    rows = ["t_s,pressure_mpa,gap_mm,measured_force_n"]
    for k in range(0, 800, 100):
        answer = stage.run("softtwin", "predict", MODEL, "--json", "--pressure", str(k / 1e4), "--gap", "40")
        rows.append((k / 200, k / 1e4, json.loads(answer.stdout)["contact_force_n"]))
    points = rows[1:]
    for k in range(701):
        a, b = points[k // 100], points[min(k // 100 + 1, len(points) - 1)]
        force = a[2] + (b[2] - a[2]) * (k % 100) / 100
        rows.append(f"{k / 200:.4f},{k / 1e4:.5f},40,{1.04 * force + 0.004 * ((7 * k) % 11 - 5) / 5:.5f}")
    (folder / "cell.csv").write_text("\n".join([rows[0], *rows[len(points) + 1:]]) + "\n")
    (folder / "cell.toml").write_text(CELL_SCENE.format(root=pathlib.Path.cwd(), trace=folder / "cell.csv"))
    twin, _ = stage.start("softtwind", "twin", "--scene", folder / "cell.toml", ready="ready:")
    bridge, _ = stage.start("softtwind", "bridge", "--scene", folder / "cell.toml", "--loop", ready="ready:")
    view, url = stage.view(MODEL)
    return (view, bridge, twin), url, in_contact


def recording(stage):
    path = pathlib.Path(stage.folder.name) / "run.mcap"
    twin, bridge = stage.twin()
    ended = stage.run("softtwin", "record", "--seconds", "6", "--out", path)
    assert ended.returncode == 0, ended.stderr
    stage.end(bridge, twin)
    view, url = stage.view(MODEL, "--recording", path)

    def ready(page):
        wait(lambda: (page.shown("t_s") or 0) > 0.5, "the recording to run", 60)
        page.click("pause")
        page.slide("scrub", 3.0)
        wait(lambda: abs(page.shown("t_s") - 3.0) < 0.2, "the place sought")
    return (view,), url, ready


def gripper(stage):
    scene = "config/scenes/gripper.toml"
    twin, _ = stage.start("softtwind", "twin", "--scene", scene, ready="ready:")
    bridge, _ = stage.start("softtwind", "bridge", "--scene", scene, ready="ready:")
    view, url = stage.view("--scene", scene)

    def ready(page):
        wait(lambda: page.run("softtwin.visible().length === 2 && softtwin.visible().every((a) => a.history.minute.bins.length > 100)"), "readings of both fingers", 60)
        wait(lambda: (page.shown("contact_force_n") or 0) > 0.3, "a grasp", 60)
        assert page.run("!document.getElementById('grasp').hidden"), "the grasp is shown"
    return (view, bridge, twin), url, ready


def whatif(stage):
    view, url = stage.view(MODEL)

    def ready(page):
        wait(lambda: page.run("softtwin.state.models.size > 0"), "the model")
        page.click("whatif-toggle")
        page.slide("input-gap", 35)
        for k in range(10, 65):
            page.slide("input-pressure", k / 1000)
            wait(lambda: page.shown("pressure_mpa") == k / 1000, "the prediction")
    return (view,), url, ready


def empty(stage):
    view, url = stage.view()

    def ready(page):
        wait(lambda: "Nothing is published yet" in page.alarm(), "the word that nothing is published")
        page.click("whatif-toggle")
    return (view,), url, ready


# From the first reading to the largest pressure, s: states of held readings follow until the recording ends.
TRACE = """(() => { const b = softtwin.chosen().history.all.bins.filter((bin) => bin.pressure_mpa);
  return [b[0].t_ms, b.reduce((a, c) => (c.pressure_mpa[1] > a.pressure_mpa[1] ? c : a)).t_ms].map((t) => t / 1000); })()"""
FILM_SIZE = (1080, 680)
FILM_STEP_S = 0.12
FILM_HOLD_MS = 1500
# A page with it opens at once; it is shown this large.
FILM_BYTES = 400_000
FILM_SHOWN = (720, 453)


def film(stage, program, path, make_page):
    """The viewer while it plays a recorded run of the reference trace, as an animated WebP at the recording's pace."""
    from PIL import Image
    folder = pathlib.Path(stage.folder.name)
    twin, _ = stage.start("softtwind", "twin", "--scene", "config/scenes/finger.toml", ready="ready:")
    with subprocess.Popen([stage.programs / "softtwin", "record", "--seconds", "8", "--out", folder / "run.mcap"], env=stage.environment) as recorder:
        wait(lambda: (folder / "run.mcap").exists(), "the recording to begin")
        stage.start("softtwind", "bridge", "--scene", "config/scenes/finger.toml", ready="ready:")
        assert recorder.wait(60) == 0, "the recording failed"
    stage.end(twin)
    view, url = stage.view(MODEL, "--recording", folder / "run.mcap")
    page = make_page(program, url)
    pictures = []
    try:
        wait(lambda: (page.shown("t_s") or 0) > 0.2, "the recording to run", 60)
        page.click("pause")
        page.browser.call("Emulation.setDeviceMetricsOverride", width=FILM_SIZE[0], height=FILM_SIZE[1], deviceScaleFactor=1, mobile=False)
        page.run(SHARP)
        begin, end = page.run(TRACE)
        steps = [begin + k * FILM_STEP_S for k in range(int((end - begin) / FILM_STEP_S) + 1)]
        for t_s in [end, *steps]:  # at the end once before, so that the view fits all shapes from the first picture on
            page.slide("scrub", t_s)
            wait(lambda: abs(page.shown("t_s") - t_s) < 0.02, "the place sought")
            settle(page)
            pictures.append(Image.open(io.BytesIO(page.browser.screenshot())).convert("RGB").resize(FILM_SHOWN, Image.Resampling.LANCZOS))
    finally:
        page.browser.close()
    stage.end(view)
    times = [int(1000 * FILM_STEP_S)] * (len(steps) - 1) + [FILM_HOLD_MS]
    for quality in (88, 80, 72, 64, 56):
        pictures[1].save(path, save_all=True, append_images=pictures[2:], duration=times, loop=0, quality=quality, method=6)
        if path.stat().st_size <= FILM_BYTES:
            break
    print(f"{path}: {len(steps)} pictures, {path.stat().st_size} bytes, quality {quality}")


def rate(stage, program, make_page, seconds=20):
    """Frames that a browser draws while a 200 Hz twin runs, counted by its animation callbacks; and its renderer."""
    processes, url, _ = live(stage)
    page = make_page(program, url)
    try:
        wait(lambda: page.frames() > 5, "frames", 60)
        counted = page.run(f"""new Promise((done) => {{
          const begin = {{ t: performance.now(), received: softtwin.state.frames }}; let drawn = 0, last = softtwin.state.frames;
          const step = (t) => {{
            if (softtwin.state.frames !== last) {{ drawn++; last = softtwin.state.frames; }}
            const s = (t - begin.t) / 1000;
            if (s < {seconds}) requestAnimationFrame(step); else done([drawn / s, (softtwin.state.frames - begin.received) / s, softtwin.painter.software, softtwin.painter.sharpness]);
          }};
          requestAnimationFrame(step);
        }})""")
    finally:
        page.browser.close()
    stage.end(*processes)
    drawn, received, software, sharpness = counted
    print(f"{drawn:.1f} frames/s with a new state drawn, {received:.1f} received, 1280 x 800, "
          f"{'without a graphics card' if software else 'with a graphics card'}, {sharpness:.2f} of the pixels along each side")


MODES = {"live": live, "cell": cell, "recording": recording, "gripper": gripper, "whatif": whatif, "empty": empty}
