"""Checks `softtwin view` from outside: in a browser, and as programs that misbehave. See scripts/check.sh."""
import argparse
import json
import math
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

from browser import Browser, WebSocket, find, wait
from picture import Picture
import screenshots

MODEL = "models/pneunet/pneunet.twin"
SCENE = "config/scenes/finger.toml"
CHECKS = []


def check(function):
    CHECKS.append(function)
    return function


class Stage:
    """A separate shared-memory domain and the programs started in it; all end with it."""

    def __init__(self, programs):
        self.programs = pathlib.Path(programs)
        self.folder = tempfile.TemporaryDirectory(prefix="softtwin-view-")
        self.environment = dict(os.environ, SOFTTWIN_DOMAIN=f"view_{os.getpid()}", SOFTTWIN_ROOT=self.folder.name)
        self.running = []

    def start(self, *command, ready):
        """Starts a program and waits for a line with `ready` in it; returns process and line."""
        log = pathlib.Path(self.folder.name) / f"log{len(self.running)}"
        with open(log, "wb") as out:
            process = subprocess.Popen([self.programs / command[0], *command[1:]], env=self.environment, stdout=out, stderr=out)
        self.running.append(process)
        found = lambda: next((line for line in log.read_text().splitlines() if ready in line), None)
        try:
            return process, wait(found, f"`{ready}` from {command}", 60, lambda: process.poll() is not None)
        except TimeoutError:
            sys.exit(f"{command}: {log.read_text()}")

    def twin(self):
        twin, _ = self.start("softtwind", "twin", "--scene", SCENE, ready="ready:")
        bridge, _ = self.start("softtwind", "bridge", "--scene", SCENE, "--loop", ready="ready:")
        return twin, bridge

    def view(self, *arguments):
        return self.start("softtwin", "view", "--port", "0", *arguments, ready="http://")

    def run(self, *command, seconds=60):
        return subprocess.run([self.programs / command[0], *command[1:]], env=self.environment, capture_output=True, text=True, timeout=seconds)

    def end(self, *processes):
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(30)
            self.running.remove(process)

    def close(self):
        for process in self.running:
            process.kill()
            process.wait()
        self.folder.cleanup()


class Page:
    """The browser in a browser, by what it says of itself (`window.softtwin`)."""

    def __init__(self, program, url):
        self.browser = Browser(program, 1280, 800)
        self.run = self.browser.run
        self.browser.open(url)
        try:
            wait(lambda: self.run("Boolean(window.softtwin)"), "the viewer's script", 60, lambda: bool(self.browser.complaints()))
        except TimeoutError:
            sys.exit(f"the viewer did not start: {self.browser.complaints()}")

    def frames(self):
        return self.run("softtwin.state.frames")

    def badge(self):
        return self.run("document.getElementById('link').textContent")

    def alarm(self):
        return self.run("document.getElementById('alarm').hidden ? '' : document.getElementById('alarm').textContent")

    def shown(self, name):
        return self.run(f"softtwin.chosen()?.shown?.{name} ?? null")

    def click(self, element):
        self.run(f"document.getElementById('{element}').click()")

    def slide(self, element, value):
        self.run(f"(() => {{ const e = document.getElementById('{element}'); e.value = {value}; e.dispatchEvent(new Event('input')); }})()")

    def choose(self, element, value):
        self.run(f"(() => {{ const e = document.getElementById('{element}'); e.value = '{value}'; e.dispatchEvent(new Event('change')); }})()")

    def resize(self, width, height):
        self.browser.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 900)

    def picture(self):
        """Screenshot after the next two frames."""
        self.run("new Promise((done) => { softtwin.state.dirty = true; requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))); })")
        return Picture(self.browser.screenshot())


def frames_of(socket, count, seconds=30):
    """The headers of `count` frames, each requested."""
    headers = []
    end = time.monotonic() + seconds
    socket.send('{"type":"ready"}')
    while len(headers) < count:
        assert time.monotonic() < end, f"{len(headers)} of {count} frames in {seconds} s"
        kind, data = socket.receive()
        if kind == 2:
            header = json.loads(data[4:4 + int.from_bytes(data[:4], "little")])
            if header["kind"] == "frame":
                headers.append(header)
                socket.send('{"type":"ready"}')
    return headers


def answer(url, **headers):
    """(status, text) of a page."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=30) as page:
            return page.status, page.read().decode(errors="replace")
    except urllib.error.HTTPError as refusal:
        return refusal.code, refusal.read().decode(errors="replace")


# The visible node with the largest stress, and the direction from which the freest look at it is: it may lie in a slot.
AIM = """(async () => {
  const { scale, camera, state, chosen } = softtwin; const { body, shape, place } = chosen();
  const { pick } = await import("/mesh.js");
  Object.assign(state, { lit: false, lines: false });
  let v = 0; body.values.forEach((value, k) => { if (value > body.values[v]) v = k; });
  const p = [0, 1, 2].map((k) => body.positions[3 * v + k] * (k === 1 ? place.flip : 1) + place.offset[k]);
  const n = [0, 1, 2].map((k) => body.normals[3 * v + k] * (k === 1 ? place.flip : 1));
  const size = Math.hypot(...n);
  let best = { score: 0 };
  for (let k = 0; k < 400; k++) {
    const y = 1 - (2 * k + 1) / 400, r = Math.sqrt(1 - y * y), turn = k * 2.399963;
    const d = [r * Math.sin(turn), y, r * Math.cos(turn)];
    const hit = pick(body, p.map((c, i) => c + 0.02 * d[i]), d, place);
    const free = Math.min(hit.distance, 30);
    const score = free * (0.2 + Math.max(0, (d[0] * n[0] + d[1] * n[1] + d[2] * n[2]) / size)); // free, and not grazing
    if (score > best.score) best = { score, free, d };
  }
  const [x, y, z] = best.d;
  const r = camera.canvas.getBoundingClientRect();
  Object.assign(camera, { target: p, distance: 0.8 * best.free, azimuth: Math.atan2(x, z), elevation: Math.asin(y) });
  return { value: body.values[v], node: body.ids[body.source[v]], published: shape.max_von_mises_mpa, published_node: shape.max_von_mises_node, range: scale.range, free_mm: best.free, centre: [r.left + r.width / 2, r.top + r.height / 2].map(Math.round) };
})()"""


def hottest(page):
    """Turns the camera to the visible node with the largest stress; returns (stress that the pixel there says, what is known of the node)."""
    page.choose("follow", "peak")  # single corners lie above the scale that shows 99 % of the nodes
    node = page.run(AIM)
    table = page.run("fetch('colours').then((r) => r.arrayBuffer()).then((b) => [...new Uint8Array(b)])")
    picture = page.picture()
    (low, high), best = node["range"], 0.0
    for dx in range(-3, 4):
        for dy in range(-3, 4):
            share = picture.place_in(table, node["centre"][0] + dx, node["centre"][1] + dy)
            best = max(best, low + share * (high - low)) if share is not None else best
    return best, node


@check
def a_page_opened_before_the_twin_waits_then_shows_frames_and_says_when_they_stop(stage, program):
    view, url = stage.view(MODEL)
    page = Page(program, url)
    try:
        wait(lambda: "Nothing is published yet" in page.alarm(), "the word that nothing is published")
        twin, bridge = stage.twin()
        wait(lambda: page.frames() > 3, "frames", 60)
        wait(lambda: page.badge() == "live", "the badge `live`")
        first, pressure = page.shown("seq"), page.shown("pressure_mpa")
        wait(lambda: page.shown("seq") > first and page.shown("pressure_mpa") != pressure, "another reading in the viewer")
        wait(lambda: (page.shown("pressure_mpa") or 0) > 0.03, "the actuator under pressure", 60)
        before = page.picture()
        picture = page.picture()
        assert picture.colours() > 500, f"the screenshot has {picture.colours()} colours only"
        assert page.run("softtwin.chosen().body.corners.length") > 3000, "the surface is drawn as facets"
        wait(lambda: page.picture().differs(before), "another picture")
        page.click("pause")
        time_shown = page.shown("seq")
        before = page.frames()
        wait(lambda: page.frames() > before, "frames during a pause")
        assert page.shown("seq") == time_shown, "a paused page stands still"
        value, node = hottest(page)
        span = node["range"][1] - node["range"][0]
        assert node["value"] <= node["published"] * (1 + 1e-6), f"the published maximum is over all nodes: {node}"
        assert abs(value - node["value"]) < 0.02 * span, f"the pixel says {value} MPa, the frame {node}"
        page.click("pause")
        stage.end(bridge)
        wait(lambda: page.badge() == "stale" and "Stale: finger" in page.alarm(), "the word that data are stale")
        stage.end(twin)
        stage.end(view)
        wait(lambda: page.badge() == "disconnected" and "lost" in page.alarm(), "the word that the viewer is gone")
        complaints = [text for text in page.browser.complaints() if "WebSocket" not in text and "ERR_CONNECTION" not in text]
        assert not complaints, complaints
    finally:
        page.browser.close()


@check
def a_lost_graphics_context_is_no_empty_picture_under_live_and_the_page_draws_again(stage, program):
    twin, bridge = stage.twin()
    view, url = stage.view(MODEL)
    page = Page(program, url)
    wait(lambda: page.badge() == "live" and page.frames() > 0, "a live picture", 30)
    page.run("window.isFirstPage = true")
    page.run("window.extension = document.getElementById('scene').getContext('webgl2').getExtension('WEBGL_lose_context')")
    page.run("window.extension.loseContext()")
    wait(lambda: page.badge() == "no picture" and page.alarm(), "a notice", 10)
    page.run("window.extension.restoreContext()")

    def is_drawn_again():
        try:
            return page.run("!window.isFirstPage && Boolean(window.softtwin) && softtwin.state.frames > 0")
        except RuntimeError:  # between two pages
            return False

    wait(is_drawn_again, "the viewer after its restart", 30)
    assert not page.run("document.getElementById('scene').getContext('webgl2').isContextLost()")
    wait(lambda: page.badge() == "live", "live", 30)
    page.browser.close()
    stage.end(view, bridge, twin)


@check
def what_if_answers_sliders_without_a_twin_and_its_colours_are_the_published_maximum(stage, program):
    view, url = stage.view(MODEL)
    page = Page(program, url)
    try:
        wait(lambda: page.run("softtwin.state.models.size > 0"), "the model")
        page.click("whatif-toggle")
        wait(lambda: page.shown("predicted"), "a prediction")
        page.slide("input-gap", 30)
        page.slide("input-pressure", 0.02)
        wait(lambda: page.shown("pressure_mpa") == 0.02 and page.shown("gap_mm") == 30, "the sliders' state")
        low = page.shown("contact_force_n")
        page.slide("input-pressure", 0.07)
        wait(lambda: page.shown("pressure_mpa") == 0.07, "the slider's new pressure")
        assert page.shown("contact_force_n") > low, "more pressure, more force"
        answer = json.loads(stage.run("softtwin", "predict", MODEL, "--json", "--pressure", "0.07", "--gap", "30").stdout)
        assert abs(page.shown("contact_force_n") - answer["contact_force_n"]) < 1e-9, answer
        _, node = hottest(page)
        span = node["range"][1] - node["range"][0]
        assert node["node"] == node["published_node"] and abs(node["value"] - node["published"]) < 1e-6, node
        # The numbers of a state can be shown before its picture is drawn.
        wait(lambda: abs(hottest(page)[0] - node["published"]) < 0.02 * span, f"the colour of {node}")
        assert page.run("document.querySelector('.mark').textContent") == f"{page.shown('contact_force_n'):.3f} N", "the arrow says the force"
        page.slide("input-pressure", 0.11)
        wait(lambda: "outside-domain" in (page.run("softtwin.chosen().shown.flags.join()") or ""), "the flag of an extrapolation")
        saved = page.run(SAVE % ("save", "save", 0))
        assert saved[0].endswith(".png") and saved[1][:8] == list(b"\x89PNG\r\n\x1a\n") and saved[2] > 20000, saved
        filmed = page.run(SAVE % ("film", "film", 4000))
        assert filmed[0].endswith(".webm") and filmed[1][:4] == [0x1A, 0x45, 0xDF, 0xA3] and filmed[2] > 5000, filmed
        assert not page.browser.complaints(), page.browser.complaints()
        stage.end(view)
    finally:
        page.browser.close()


def saved(stage, model, *more):
    """A page of `softtwin export`, opened from disk; None where this build has no code for browsers."""
    file = pathlib.Path(stage.folder.name) / f"{pathlib.Path(model).stem}{len(more)}.html"
    made = stage.run("softtwin", "export", model, "--out", file, "--json", *more)
    if made.returncode == 78 and "scripts/page.sh" in made.stderr:
        print("   not checked: this build has no code for browsers (scripts/page.sh makes it)")
        return None
    assert made.returncode == 0, made.stderr
    return file


@check
def a_saved_page_answers_as_predict_without_a_server(stage, program):
    file = saved(stage, MODEL)
    if file is None:
        return
    page = Page(program, file.as_uri())
    try:
        wait(lambda: page.shown("predicted"), "a prediction", 60)
        print(f"   {file.stat().st_size * 1e-6:.1f} MB, first picture after {page.run('performance.now()') / 1000:.1f} s at most")
        median_ms = page.run(NEXT_STATES)
        print(f"   the next state takes {median_ms:.1f} ms in the median, without the picture; {page.run(PICTURES)} pictures a second while the pressure changes")
        # Free, in contact, at the edge, outside.
        for pressure, gap in ((0.01, 60), (0.03, 30), (0.07, 30), (0.09, 71), (0.1, 25)):
            page.slide("input-gap", gap)
            page.slide("input-pressure", pressure)
            wait(lambda: page.shown("pressure_mpa") == pressure and page.shown("gap_mm") == gap, "the sliders' state")
            answer = json.loads(stage.run("softtwin", "predict", MODEL, "--json", "--pressure", str(pressure), "--gap", str(gap)).stdout)
            widths = answer["half_widths"] or {}
            for name, expected in (("contact_force_n", answer["contact_force_n"]), ("force_halfwidth_n", widths.get("force_n")),
                                   ("displacement_halfwidth_mm", widths.get("displacement_mm")), ("von_mises_halfwidth_mpa", widths.get("stress_mpa"))):
                found = page.shown(name)
                same = found == expected or abs(found - expected) <= 1e-12 * abs(expected)
                assert same, f"{name} at {pressure} MPa, {gap} mm: the page {found}, predict {expected}"
            assert page.shown("regime") == answer["regime"]
        fields = pathlib.Path(stage.folder.name) / "state.csv"
        assert stage.run("softtwin", "export", MODEL, "--pressure", "0.1", "--gap", "25", "--out", fields).returncode == 0
        with open(fields) as rows:
            names = next(rows).strip().split(",")
            columns = [names.index(name) for name in ("x_mm", "y_mm", "z_mm", "von_mises_mpa")]
            expected = [[float(row.split(",")[k]) for k in columns] for row in rows]
        nodes = page.run("[...softtwin.chosen().body.ids]")
        shown = page.run("['x', 'y', 'z', 'von_mises'].map((name) => [...softtwin.chosen().shape.fields[name]])")
        for k, name in enumerate(("x", "y", "z", "von_mises")):
            found, whole = shown[k], [expected[node][k] for node in nodes]
            span = max(whole) - min(whole)
            worst = max(abs(a - b) for a, b in zip(found, whole))
            print(f"   {name}: largest difference {worst / span:.1e} of its range at {len(nodes)} nodes")
            # Integers of neighbouring nodes share a word, so another choice of nodes rounds modes once more; of stress some have 4 bits.
            assert worst < (1e-3 if name == "von_mises" else 1e-5) * span, f"{name} differs by {worst} of {span}"
        assert not page.browser.complaints(), page.browser.complaints()
    finally:
        page.browser.close()


@check
def a_saved_page_plays_a_trace_and_a_body_with_inertia_swings_in_it(stage, program):
    file = saved(stage, MODEL, "--recording", "config/traces/gap40.csv")
    if file is None:
        return
    page = Page(program, file.as_uri())
    try:
        wait(lambda: page.badge() == "recording gap40" and (page.shown("t_s") or 0) > 0.2, "the trace to play", 60)
        page.click("pause")
        page.slide("scrub", 3)
        wait(lambda: page.shown("t_s") == 3, "the time that was asked for")
        answer = json.loads(stage.run("softtwin", "predict", MODEL, "--json", "--pressure", str(page.shown("pressure_mpa")), "--gap", str(page.shown("gap_mm"))).stdout)
        assert abs(page.shown("contact_force_n") - answer["contact_force_n"]) <= 1e-12, answer
        assert not page.browser.complaints(), page.browser.complaints()
    finally:
        page.browser.close()
    page = Page(program, saved(stage, "models/pneunet/motion/pneunet-motion.twin").as_uri())
    try:
        wait(lambda: page.shown("predicted"), "a prediction", 60)
        height = lambda: page.run("softtwin.chosen().shape.fields.y.reduce((a, b) => Math.min(a, b), 0)")
        page.slide("input-gap", 80)
        page.slide("input-pressure", 0.05)
        first = height()
        heights = []
        wait(lambda: heights.append(height()) or len(set(heights)) > 5, "the body to move while the sliders stand still", 30)
        assert max(heights) - min(heights) > 0.01 * abs(first), heights
        assert not page.browser.complaints(), page.browser.complaints()
    finally:
        page.browser.close()


@check
def what_if_has_a_slider_for_every_input_and_numbers_show_the_parameters(stage, program):
    view, url = stage.view("models/pneunet-design/pneunet-design.twin")
    page = Page(program, url)
    try:
        wait(lambda: page.run("softtwin.state.models.size > 0"), "the model")
        page.click("whatif-toggle")
        wait(lambda: page.shown("predicted"), "a prediction")
        assert page.run("document.querySelectorAll('.slider input').length") == 7
        value = lambda: page.run("softtwin.chosen()?.shown?.inputs?.[2] ?? null")
        assert value() == 0.8, f"a parameter begins at its nominal value, found {value()}"
        page.slide("input-gap", 30)
        page.slide("input-pressure", 0.07)
        page.slide("input-elastomer.law.mu_mpa", 0.7)
        wait(lambda: value() == 0.7, "the slider's stiffness")
        answer = json.loads(stage.run("softtwin", "predict", "models/pneunet-design/pneunet-design.twin", "--json", "--pressure", "0.07",
                                      "--gap", "30", "--set", "elastomer.law.mu_mpa=0.7").stdout)
        assert abs(page.shown("contact_force_n") - answer["contact_force_n"]) < 1e-9, answer
        numbers = lambda: page.run("[...document.querySelectorAll('.number')].map((box) => box.textContent).join(' | ')").replace(" ", "").replace("−", "-")
        derivative = f"dF{answer['dforce']['elastomer.law.mu_mpa']:.3g}"
        # The numbers are written at most a few times per second, after the state.
        wait(lambda: "elastomer.law.mu_mpa0.7000" in numbers() and derivative in numbers(), f"stiffness 0.7000 and {derivative} in the numbers")
        assert not page.browser.complaints(), page.browser.complaints()
        stage.end(view)
    finally:
        page.browser.close()


@check
def cavities_and_materials_have_their_colours_and_a_legend_with_pressures(stage, program):
    cases, database, model, part = (pathlib.Path(stage.folder.name) / name for name in ("cases.csv", "two", "two.twin", "part.toml"))
    cases.write_text("case,regime,split,pressure_mpa,gap_mm,pressure_mpa.lower\n" + "".join(f"s{a}{b},free,train,{a},,{b}\n" for a in (0, 0.03) for b in (0, 0.03)))
    text = pathlib.Path("models/shapes/two-chambers/actuator.toml").read_text().replace('"mesh.msh"', f'"{os.getcwd()}/models/shapes/two-chambers/mesh.msh"')
    part.write_text(text + "[materials.silicone]" + text.split("[elastomer]")[1].split("[pressure_mpa]")[0].replace("[elastomer", "[materials.silicone"))
    made = stage.run("softtwin", "simulate", "--actuator", part, "--cases", cases, "--out", database, seconds=300)
    assert made.returncode == stage.run("softtwin", "train", "--database", database, "--out", model).returncode == 0, made.stderr
    view, url = stage.view(model)
    page = Page(program, url)
    wait(lambda: page.run("softtwin.state.models.size > 0"), "the model")
    page.click("whatif-toggle")
    page.slide("input-pressure", 0.02)
    page.choose("field", "cavities")
    legend = "[...document.querySelectorAll('.cavity')].map((entry) => entry.textContent.trim()).join('|')"
    wait(lambda: page.run(legend) == "cavity 20.0 kPa|cavity.lower 0.0 kPa|material.silicone", "the legend")
    assert page.run("(([upper, lower]) => Math.min(...upper) > Math.min(...lower) + 4)(softtwin.chosen().cavities.map(({ walls }) => walls.positions.filter((_, k) => k % 3 === 1)))")
    assert not page.browser.complaints(), page.browser.complaints()
    page.browser.close()
    stage.end(view)


@check
def the_pictures_of_a_comparison_and_the_curves_of_a_measured_model_are_on_a_page(stage, program):
    folder = pathlib.Path(stage.folder.name)
    rows = [(0.1 * k, 30 - 30 * math.cos(0.2 * k)) for k in range(300)]
    (folder / "run.csv").write_text("t,p,angle\n" + "".join(f"{t},{p},{1.5 * p}\n" for t, p in rows))
    (folder / "log.toml").write_text('[time]\ncolumn = "t"\n[[input]]\nname = "pressure_mpa"\ncolumn = "p"\nunit = "kPa"\n'
                                     '[[output]]\nname = "angle_deg"\ncolumn = "angle"\nunit = "deg"\n')
    run, log, model, out = (str(folder / name) for name in ("run.csv", "log.toml", "mine.twin", "compared"))
    learned = stage.run("softtwin", "learn", run, "--log", log, "--out", model)
    compared = stage.run("softtwin", "compare", model, "--recording", run, "--log", log, "--out", out)
    assert learned.returncode == compared.returncode == 0, learned.stderr + compared.stderr
    view, url = stage.view(model, "--compare", out)
    page = Page(program, url)
    try:
        wait(lambda: page.run("!document.getElementById('pictures').hidden"), "the link to the pictures")
        page.browser.open(url + "pictures")
        widths = lambda: page.run("[...document.images].map((image) => image.complete ? image.naturalWidth : 0)")
        # The comparison and the model's curves; a model without coordinates has no body.
        wait(lambda: len(widths()) == 2 and min(widths()) > 100, "two pictures")
        assert not page.browser.complaints(), page.browser.complaints()
        stage.end(view)
    finally:
        page.browser.close()


# Time of a state along a slider's way, ms: the model's answer, and what the page makes of it before it draws.
NEXT_STATES = """(() => {
    const { link } = softtwin, times = [];
    for (let k = 0; k < 100; k++) {
        const began = performance.now();
        link.send({ type: "predict", inputs: { pressure_mpa: 0.0009 * k, gap_mm: 30 } });
        times.push(performance.now() - began);
    }
    return times.sort((a, b) => a - b)[50];
})()"""

# Pictures that were drawn in the last of three seconds in which every frame asks for another pressure.
PICTURES = """new Promise((done) => {
    const began = performance.now();
    const ask = (now) => {
        if (now - began > 3000) return done(softtwin.state.drawn.length);
        softtwin.link.send({ type: "predict", inputs: { pressure_mpa: 0.045 + 0.04 * Math.sin((now - began) / 500), gap_mm: 30 } });
        requestAnimationFrame(ask);
    };
    requestAnimationFrame(ask);
})"""

# Presses a button, and again after a while if that is asked for; the name, the first bytes and the size of what is then saved.
SAVE = """new Promise((done) => {
  const make = URL.createObjectURL;
  let blob;
  URL.createObjectURL = (made) => { blob = made; return make.call(URL, made); };
  HTMLAnchorElement.prototype.click = function () { blob.arrayBuffer().then((b) => done([this.download, [...new Uint8Array(b.slice(0, 8))], b.byteLength])); };
  document.getElementById('%s').click();
  const [again, after_ms] = ['%s', %d];
  if (after_ms) setTimeout(() => document.getElementById(again).click(), after_ms);
})"""

# What lies outside the screen's width, is covered by something else, or (of the scene) outside the canvas.
HIDDEN = """(() => {
  const names = ["#actuators button", "#tools button", "#dock select", "#bar", "#whatif-toggle", "#grasp", ".number", ".chart", "#pause", "#scrub", "#scene", ".slider"];
  const found = [];
  for (const element of document.querySelectorAll(names.join())) {
    if (element.closest("[hidden]")) continue;
    element.scrollIntoView({ block: "center" });
    const box = element.getBoundingClientRect();
    const top = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
    const seen = top && (element.contains(top) || top.contains(element) || top.closest("#stage"));
    if (box.left < 0 || box.right > innerWidth || box.width < 8 || !seen) found.push(element.id || element.className || element.textContent);
  }
  const { camera, scene } = softtwin;
  const out = scene.seen.filter((point) => { const [x, y] = camera.project(point) ?? [-1, -1]; return x < 0 || y < 0 || x > camera.canvas.clientWidth || y > camera.canvas.clientHeight; });
  return [...found, ...out.map((point) => `point ${point}`)];
})()"""


@check
def without_a_model_nodes_are_points_and_a_second_browser_sees_the_same(stage, program):
    twin, bridge = stage.twin()
    view, url = stage.view()
    page, other = Page(program, url), None
    try:
        wait(lambda: page.frames() > 2, "frames", 60)
        assert "drawn as points" in page.run("document.getElementById('notice').textContent")
        page.click("whatif-toggle")
        assert "softtwin view FILE.twin" in page.run("document.getElementById('whatif').textContent"), "what if says what it needs"
        for width, height in screenshots.SIZES:
            page.resize(width, height)
            screenshots.settle(page)
            assert page.run(screenshots.CUT) == [], f"cut off at {width} x {height}: {page.run(screenshots.CUT)}"
        assert page.run("softtwin.chosen().body.corners === undefined && softtwin.chosen().body.nodes") == 25022
        assert page.picture().colours() > 200, "points are visible"
        other = Page(program, url)
        wait(lambda: other.frames() > 2, "frames in the second browser", 60)
        before = page.frames()
        wait(lambda: page.frames() > before, "more frames in the first one")
        stage.end(view, bridge, twin)
    finally:
        page.browser.close()
        if other:
            other.browser.close()


@check
def a_scene_says_where_its_fingers_and_blocks_stand(stage, program):
    scene = "config/scenes/gripper.toml"
    twin, _ = stage.start("softtwind", "twin", "--scene", scene, ready="ready:")
    bridge, _ = stage.start("softtwind", "bridge", "--scene", scene, ready="ready:")
    view, url = stage.view("--scene", scene)
    page = Page(program, url)
    try:
        wait(lambda: page.run("[...softtwin.state.actuators.keys()].sort().join()") == "left,right", "both fingers", 60)
        wait(lambda: page.run("softtwin.visible().every((a) => a.body?.corners)"), "both surfaces", 60)
        low = page.run("softtwin.visible().map((a) => [a.name, a.box().low[1]]).sort().map((pair) => pair[1])")
        assert low[1] < low[0] - 20, f"the right finger is mirrored and stands below: {low}"
        assert page.run("softtwin.state.blocks.length") == 1
        assert page.picture().colours() > 300
        page.run("document.querySelectorAll('#actuators button')[1].click()")
        wait(lambda: page.run("softtwin.chosen().name") == "right", "the numbers of the other finger")
        wait(lambda: page.run("!document.getElementById('grasp').hidden"), "the grasp")
        spans = "softtwin.visible().map((a) => { const b = a.history.minute.bins; return [b.length, (b[b.length - 1].t_ms - b[0].t_ms) / 1000]; })"
        wait(lambda: all(seconds > 3 for _, seconds in page.run(spans)), "three seconds of readings", 60)
        for bins, seconds in page.run(spans):
            assert bins > 8 * seconds, f"{bins} stretches of 50 ms have readings in {seconds} s, however few frames are drawn"
        for width, height in ((390, 844), (820, 1180), (1280, 720)):
            page.resize(width, height)
            for _ in range(2):  # with "what if" closed and open
                screenshots.settle(page)
                assert page.run(HIDDEN) == [], f"hidden at {width} x {height}: {page.run(HIDDEN)}"
                assert page.run(screenshots.CUT) == [], f"cut off at {width} x {height}: {page.run(screenshots.CUT)}"
                page.click("whatif-toggle")
                wait(lambda: page.run("softtwin.visible().length > 0"), "the other mode")
        stage.end(view, bridge, twin)
    finally:
        page.browser.close()


@check
def a_measured_force_stands_beside_the_predicted_one_and_all_of_it_fits(stage, program):
    processes, url, ready = screenshots.cell(stage)
    page = Page(program, url)
    try:
        ready(page)
        numbers = page.run("[...document.querySelectorAll('.number')].map((box) => box.textContent).join(' | ')")
        assert "measured force" in numbers and ("N above predicted" in numbers or "N below predicted" in numbers), numbers
        assert "measured" in page.run("document.querySelectorAll('.chart .name')[1].textContent"), "the chart of forces shows both"
        for width, height in screenshots.SIZES:
            page.resize(width, height)
            for _ in range(3):
                screenshots.settle(page)
                assert page.run(screenshots.CUT) == [], f"cut off at {width} x {height}: {page.run(screenshots.CUT)}"
                assert "–" not in page.run("[...document.querySelectorAll('.number .value')].map((box) => box.textContent.trim())"), "every number is known"
                assert page.run("document.getElementById('scrub').value") == "0", "the time bar is at its end until it is moved"
        stage.end(*processes)
    finally:
        page.browser.close()


@check
def a_page_that_floods_is_shown_the_door_and_one_that_stalls_disturbs_nobody(stage, program):
    twin, bridge = stage.twin()
    view, url = stage.view(MODEL)
    socket = url.replace("http", "ws") + "ws"
    stalled = [WebSocket(socket) for _ in range(3)]
    for page in stalled:
        page.send('{"type":"ready"}')  # and nothing more
    flood = WebSocket(socket)
    try:
        for _ in range(5000):
            flood.send('{"type":"ready"}')
        closed = next(data for kind, data in iter(flood.receive, None) if kind == 8)
        assert b"too many messages" in closed, closed
    except (ConnectionError, OSError):
        pass  # the door may shut before the reason is read
    for nonsense in ('{"type":"shout"}', "[]", "x" * 100, '{"type":"seek","at_s":"soon"}'):
        rude = WebSocket(socket)
        rude.send(nonsense)
        kind, reason = next((kind, data) for kind, data in iter(rude.receive, None) if kind == 8)
        assert b"not a message of softtwin view" in reason, (nonsense, reason)
    polite = WebSocket(socket)
    headers = frames_of(polite, 10)
    numbers = [header["seq"] for header in headers]
    assert numbers == sorted(numbers) and numbers[-1] > numbers[0], numbers
    time.sleep(1.5)  # a slow page: what it misses meanwhile must not wait in a queue
    late = frames_of(polite, 3)
    newest = json.loads(stage.run("softtwin", "echo", "softtwin/finger/state", "--once", "--json").stdout)["sample"]
    assert newest["seq"] - late[-1]["seq"] < 200, (newest["seq"], [header["seq"] for header in late])
    stage.end(view, bridge, twin)


@check
def ports_paths_hosts_and_tokens_are_guarded(stage, program):
    view, url = stage.view(MODEL)
    port = url.rsplit(":", 1)[1].strip("/")
    taken = stage.run("softtwin", "view", "--port", port)
    assert taken.returncode == 1 and "is a viewer running already" in taken.stderr, taken
    assert answer(url)[0] == 200
    assert answer(url, Host="evil.example")[0] == 403
    assert answer(url, Origin="http://evil.example")[0] == 403
    for path in ("../Cargo.toml", "%2e%2e/Cargo.toml", "etc/passwd", "main.js/../../x"):
        assert answer(url + path)[0] in (400, 404), path
    socket = WebSocket(url.replace("http", "ws") + "ws")
    socket.send('{"type":"open","name":"../../etc/passwd"}')
    messages = (json.loads(data) for kind, data in iter(socket.receive, None) if kind == 1)
    refused = next(text for text in messages if text["type"] == "refused")
    assert "--recording" in refused["text"], refused
    socket.send('{"type":"predict","model":7,"inputs":{"pressure_mpa":0.01}}')
    assert "no model 7" in next(text for text in messages if text["type"] == "refused")["text"]
    socket.send('{"type":"predict","model":0,"inputs":{"pressure_mpa":-1}}')
    assert "expected a pressure of 0" in next(text for text in messages if text["type"] == "refused")["text"]
    stage.end(view)
    view, url = stage.view(MODEL, "--bind", "0.0.0.0")
    token = url.split("token=")[1]
    base = url.split("?")[0].replace("0.0.0.0", "127.0.0.1")
    assert len(token) == 32 and answer(base)[0] == 403 and answer(base + "?token=" + "0" * 32)[0] == 403
    status, text = answer(base + "?token=" + token)
    assert status == 200 and "softtwin" in text
    for wrong in ("short", "with space 1"):
        ended = stage.run("softtwin", "view", "--port", "0", "--token", wrong)
        assert ended.returncode == 2 and "8 to 64 letters and digits" in ended.stderr, ended
    stage.end(view)


@check
def a_recording_plays_seeks_stops_and_only_those_of_the_folder_open(stage, program):
    folder = pathlib.Path(stage.folder.name)
    twin, bridge = stage.twin()
    for name in ("first.mcap", "second.mcap"):
        ended = stage.run("softtwin", "record", "--seconds", "4", "--out", folder / name)
        assert ended.returncode == 0, ended.stderr
    stage.end(bridge, twin)
    view, url = stage.view(MODEL, "--recording", str(folder))
    page = Page(program, url)
    try:
        wait(lambda: page.badge() == "recording first.mcap", "the recording's name", 60)
        wait(lambda: (page.shown("t_s") or 0) > 0.5, "the recording to run")
        assert page.run("softtwin.chosen().body.corners.length") > 3000, "the model makes the surface"
        assert page.run("softtwin.chosen().history.all.bins.length") > 100, "the charts know the whole recording"
        page.click("pause")
        wait(lambda: page.shown("playing") is False, "the recording to stand still")
        page.slide("scrub", 3.0)
        wait(lambda: abs(page.shown("t_s") - 3.0) < 0.2, "the state nearest to the place sought")
        assert page.picture().colours() > 300
        page.run("(() => { const e = document.getElementById('recordings'); e.value = 'second.mcap'; e.onchange(); })()")
        wait(lambda: page.badge() == "recording second.mcap", "the second recording")
        socket = WebSocket(url.replace("http", "ws") + "ws")
        for wrong in ("../view.png", "/etc/passwd", "third.mcap"):
            socket.send(json.dumps({"type": "open", "name": wrong}))
            messages = (json.loads(data) for kind, data in iter(socket.receive, None) if kind == 1)
            refused = next(text for text in messages if text["type"] == "refused")
            assert "expected a recording of the folder (first.mcap, second.mcap)" in refused["text"], refused
        stage.end(view)
    finally:
        page.browser.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", required=True, help="folder of softtwin and softtwind")
    parser.add_argument("--screenshots", type=pathlib.Path, help="instead of the checks, screenshots of every mode and size into this folder")
    parser.add_argument("--film", type=pathlib.Path, help="the README's moving picture (docs/images/view.webp); needs Pillow")
    parser.add_argument("--rate", action="store_true", help="frames a second that this browser draws")
    parser.add_argument("--only", default="", help="checks whose name contains this")
    options = parser.parse_args()
    program = find()
    if not program:
        sys.exit("check.sh view: no Chromium found; apt-get install chromium, or name one in CHROMIUM")
    os.chdir(pathlib.Path(__file__).resolve().parents[2])
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    if options.screenshots or options.film or options.rate:
        stage = Stage(options.programs)
        try:
            if options.screenshots:
                screenshots.take(stage, program, options.screenshots.resolve(), Page, options.only)
            if options.film:
                screenshots.film(stage, program, options.film.resolve(), Page)
            if options.rate:
                screenshots.rate(stage, program, Page)
        finally:
            stage.close()
        return
    for function in CHECKS:
        if options.only not in function.__name__:
            continue
        started, stage = time.monotonic(), Stage(options.programs)
        try:
            function(stage, program)
        finally:
            stage.close()
        print(f"ok {time.monotonic() - started:5.1f} s  {function.__name__.replace('_', ' ')}", flush=True)


if __name__ == "__main__":
    main()
